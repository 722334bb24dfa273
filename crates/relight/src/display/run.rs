//! A run of pixels through a tone curve, many lanes at a time: the same code compiled for what the machine has.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "a call of a function compiled for AVX2, after it was detected")
)]

use super::{TABLE_LEN, exposed};

/// Pixels whose colors go through a curve together, so that the compiler can use vector registers.
const LANES: usize = 16;

/// `pixel_of` takes the number of a pixel in the run and its steps in the table.
pub(super) fn encode_run<P>(
    tone: impl Fn([f32; 3]) -> [f32; 3],
    gain: f32,
    pixel_of: impl Fn(usize, [i32; 3]) -> P,
    pixels: &[[f32; 3]],
    out: &mut [P],
) {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: AVX2 was just found.
        return unsafe { avx2(tone, gain, pixel_of, pixels, out) };
    }
    portable(tone, gain, pixel_of, pixels, out);
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<P>(
    tone: impl Fn([f32; 3]) -> [f32; 3],
    gain: f32,
    pixel_of: impl Fn(usize, [i32; 3]) -> P,
    pixels: &[[f32; 3]],
    out: &mut [P],
) {
    portable(tone, gain, pixel_of, pixels, out);
}

#[inline(always)]
fn portable<P>(
    tone: impl Fn([f32; 3]) -> [f32; 3],
    gain: f32,
    pixel_of: impl Fn(usize, [i32; 3]) -> P,
    pixels: &[[f32; 3]],
    out: &mut [P],
) {
    for (chunk, (out, pixels)) in out.chunks_mut(LANES).zip(pixels.chunks(LANES)).enumerate() {
        // Channel by channel, so that a vector register holds one channel of all.
        let (mut red, mut green, mut blue) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
        for (i, rgb) in pixels.iter().enumerate() {
            (red[i], green[i], blue[i]) = (rgb[0], rgb[1], rgb[2]);
        }
        let mut steps = [[0; LANES]; 3];
        for i in 0..LANES {
            let [r, g, b] = tone([exposed(red[i], gain), exposed(green[i], gain), exposed(blue[i], gain)]);
            (steps[0][i], steps[1][i], steps[2][i]) = (step_of(r), step_of(g), step_of(b));
        }
        for (i, out) in out.iter_mut().enumerate() {
            *out = pixel_of(chunk * LANES + i, [steps[0][i], steps[1][i], steps[2][i]]);
        }
    }
}

/// Place in the table of what a tone curve answers.
#[inline(always)]
fn step_of(curved: f32) -> i32 {
    // What is added moves the rounded number into the low bits of the mantissa; what is no number ends in zeros.
    const SHIFT: f32 = (1 << 23) as f32;
    let scaled = curved.clamp(0.0, 1.0) * (TABLE_LEN - 1) as f32;
    ((scaled + SHIFT).to_bits() & 0x007f_ffff) as i32
}
