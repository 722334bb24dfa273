//! What turns decoded elements into what accessors read. Lengths of `bytes` are multiples of the stride.

use std::f32::consts::FRAC_1_SQRT_2;

/// Unit vectors in octahedral encoding, four components of 1 or 2 bytes; the fourth stays.
#[expect(
    clippy::cast_possible_truncation,
    reason = "numbers of 8 and 16 bits, which a cast of a float ends at, as the filters say"
)]
pub(super) fn octahedral(bytes: &mut [u8], stride: usize) {
    each(bytes, stride, |[x, y, one, w]| {
        let (x, y) = (x as f32 / one as f32, y as f32 / one as f32);
        let z = 1.0 - x.abs() - y.abs();
        let fold = z.min(0.0);
        let vector = [x - fold.copysign(x), y - fold.copysign(y), z];
        let length = vector.iter().map(|v| v * v).sum::<f32>().sqrt();
        let max = if stride == 4 { 127.0 } else { 32767.0 };
        let [x, y, z] = vector.map(|v| (v / length * max).round() as i32);
        [x, y, z, w]
    });
}

/// Quaternions without their largest component, four components of 2 bytes.
#[expect(clippy::arithmetic_side_effects, reason = "two numbers below 4")]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers of 8 and 16 bits, which a cast of a float ends at, as the filters say"
)]
pub(super) fn quaternion(bytes: &mut [u8]) {
    each(bytes, 8, |input| {
        let one = (input[3] | 3) as f32;
        let small = [0, 1, 2].map(|i| input[i] as f32 / one * FRAC_1_SQRT_2);
        let largest = (1.0 - small.iter().map(|v| v * v).sum::<f32>()).max(0.0).sqrt();
        let place = (input[3] & 3) as usize;
        let mut output = [0; 4];
        for (nth, value) in [largest, small[0], small[1], small[2]].into_iter().enumerate() {
            output[(place + nth) % 4] = (value * 32767.0).round() as i32;
        }
        output
    });
}

/// Numbers of a signed exponent, 8 bits, and a signed mantissa, 24 bits.
pub(super) fn exponential(bytes: &mut [u8]) {
    for word in bytes.as_chunks_mut::<4>().0 {
        let code = i32::from_le_bytes(*word);
        let (exponent, mantissa) = (code >> 24, code << 8 >> 8);
        *word = (mantissa as f32 * 2.0_f32.powi(exponent)).to_le_bytes();
    }
}

/// Colors as luma and two differences, four components of 1 or 2 bytes; the highest bit of the fourth tells their width.
#[expect(clippy::arithmetic_side_effects, reason = "sums of three numbers of 16 bits")]
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers of 8 and 16 bits, which a cast of a float ends at, as the filters say"
)]
pub(super) fn color(bytes: &mut [u8], stride: usize) {
    let mask = if stride == 4 { 0xFF } else { 0xFFFF };
    each(bytes, stride, |[y, orange, green, alpha]| {
        let (y, alpha) = (y & mask, alpha & mask);
        let n_bits = (alpha as u32).checked_ilog2().unwrap_or(0) + 1;
        let most = (1 << n_bits) - 1;
        let alpha = alpha & (most >> 1);
        let linear = [y + orange - green, y + green, y - orange - green, alpha << 1 | alpha & 1];
        linear.map(|v| (v as f32 * (mask as f32 / most as f32)).round() as i32)
    });
}

/// Changes elements of four signed components of `stride / 4` bytes each.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "numbers of 8 and 16 bits, which a cast of a float ends at, as the filters say"
)]
fn each(bytes: &mut [u8], stride: usize, change: impl Fn([i32; 4]) -> [i32; 4]) {
    if stride == 4 {
        for element in bytes.as_chunks_mut::<4>().0 {
            *element = change(element.map(|byte| i32::from(byte as i8))).map(|value| value as u8);
        }
        return;
    }
    for element in bytes.as_chunks_mut::<8>().0 {
        #[expect(clippy::arithmetic_side_effects, reason = "an element has eight bytes")]
        let input = std::array::from_fn(|i| i32::from(i16::from_le_bytes([element[2 * i], element[2 * i + 1]])));
        for (to, value) in element.as_chunks_mut::<2>().0.iter_mut().zip(change(input)) {
            *to = (value as u16).to_le_bytes();
        }
    }
}
