//! Procedural images: planks, rug, oak, leather grain, plaster relief; and what the pictures on the walls are drawn with.

use glam::{Vec2, Vec3, vec2, vec3};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};

use crate::glb::EncodedImage;

/// How an image is stored.
#[derive(Clone, Copy)]
pub enum Codec {
    /// Without loss: normals and flat color.
    Png,
    /// With a quality of 1…100: surfaces with grain.
    Jpeg(u8),
}

/// Draws an image from encoded sRGB (or plain) values at points of 0…1 × 0…1, four samples per pixel.
pub fn draw(name: &'static str, size: (u32, u32), codec: Codec, color: impl Fn(Vec2) -> Vec3) -> EncodedImage {
    let (width, height) = size;
    let scale = vec2(width as f32, height as f32).recip();
    let mut pixels = Vec::with_capacity(width as usize * height as usize * 3);
    for y in 0..height {
        for x in 0..width {
            let corner = vec2(x as f32, y as f32);
            let offsets = [vec2(0.25, 0.25), vec2(0.75, 0.25), vec2(0.25, 0.75), vec2(0.75, 0.75)];
            let sum: Vec3 = offsets.into_iter().map(|offset| color((corner + offset) * scale)).sum();
            let rgb = (sum / 4.0).clamp(Vec3::ZERO, Vec3::ONE) * 255.0 + 0.5;
            pixels.extend(rgb.to_array().map(|c| c as u8));
        }
    }
    encode(name, size, codec, &pixels)
}

fn encode(name: &'static str, (width, height): (u32, u32), codec: Codec, pixels: &[u8]) -> EncodedImage {
    let mut bytes = Vec::new();
    let rgb = ExtendedColorType::Rgb8;
    let (mime_type, result) = match codec {
        Codec::Png => ("image/png", PngEncoder::new(&mut bytes).write_image(pixels, width, height, rgb)),
        Codec::Jpeg(quality) => {
            let encoder = JpegEncoder::new_with_quality(&mut bytes, quality);
            ("image/jpeg", encoder.write_image(pixels, width, height, rgb))
        }
    };
    result.expect("encoding into memory succeeds");
    EncodedImage { name, mime_type, bytes }
}

/// Encoded sRGB color of `0xRRGGBB`.
pub fn hex(rgb: u32) -> Vec3 {
    vec3((rgb >> 16 & 255) as f32, (rgb >> 8 & 255) as f32, (rgb & 255) as f32) / 255.0
}

/// A random number of 0…1 that belongs to a lattice cell.
pub fn random(x: i32, y: i32, seed: u32) -> f32 {
    let mut h = x.cast_unsigned().wrapping_mul(0x9E37_79B1) ^ y.cast_unsigned().wrapping_mul(0x85EB_CA77);
    h ^= seed.wrapping_mul(0xC2B2_AE3D);
    h = (h ^ h >> 15).wrapping_mul(0x2C1B_3C6D);
    h = (h ^ h >> 12).wrapping_mul(0x297A_2D39);
    h ^= h >> 15;
    (h >> 8) as f32 / 16_777_216.0
}

/// Smooth noise of 0…1 on a lattice that repeats after `period` cells.
pub fn noise(p: Vec2, period: (i32, i32), seed: u32) -> f32 {
    let cell = p.floor();
    let t = p - cell;
    let t = t * t * (3.0 - 2.0 * t);
    let corner = |dx: i32, dy: i32| {
        random((cell.x as i32 + dx).rem_euclid(period.0), (cell.y as i32 + dy).rem_euclid(period.1), seed)
    };
    let lerp = |a: f32, b: f32, t: f32| a + (b - a) * t;
    lerp(lerp(corner(0, 0), corner(1, 0), t.x), lerp(corner(0, 1), corner(1, 1), t.x), t.y)
}

/// Octaves of noise, about 0…1; `cells` lattice cells cover 0…1 along each side.
pub fn fractal(p: Vec2, cells: (i32, i32), n_octaves: u32, seed: u32) -> f32 {
    let mut sum = 0.0;
    for octave in 0..n_octaves {
        let cells = (cells.0 << octave, cells.1 << octave);
        let q = p * vec2(cells.0 as f32, cells.1 as f32);
        sum += noise(q, cells, seed + octave) * 0.5_f32.powi(octave.cast_signed() + 1);
    }
    sum / (1.0 - 0.5_f32.powi(n_octaves.cast_signed()))
}

/// 0 below `from`, 1 above `to`, smooth between.
pub fn smoothstep(from: f32, to: f32, x: f32) -> f32 {
    let t = ((x - from) / (to - from)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A floor of oak planks, 0.2 m wide and 1.2 m long, that run along v: a tile of 2.4 m × 2.4 m.
pub fn planks() -> EncodedImage {
    const N_COLUMNS: f32 = 12.0;
    const GAP: f32 = 0.008;
    draw("oak planks", (1024, 1024), Codec::Jpeg(84), |p| {
        let column = (p.x * N_COLUMNS).floor();
        let along = (p.y + random(column as i32, 0, 91)).fract() * 2.0;
        let tone = random(column as i32, along as i32, 92);
        // Each plank shows another part of the tree.
        let q = vec2(p.y + 7.0 * tone, p.x + 3.0 * tone);
        let warp = fractal(q, (3, 12), 3, 93);
        let rings = (fractal(vec2(q.x, q.y + 0.03 * warp), (1, 20), 3, 94) * 9.0).fract();
        let grain = smoothstep(0.0, 0.75, rings) * (1.0 - smoothstep(0.85, 1.0, rings));
        let pores = smoothstep(0.6, 0.8, fractal(q, (8, 220), 2, 95));
        let color = hex(0xa47b52).lerp(hex(0xbb9468), grain) * (0.84 + 0.2 * tone + 0.1 * (warp - 0.5));
        let across = (p.x * N_COLUMNS).fract();
        let gap = across.min(1.0 - across) < GAP || along.fract().min(1.0 - along.fract()) < GAP / 6.0;
        if gap { hex(0x5a4128) } else { color * (1.0 - 0.16 * pores) }
    })
}

/// A rug of undyed wool with two bands of rust and fine ribs across.
pub fn rug() -> EncodedImage {
    draw("rug", (512, 512), Codec::Jpeg(84), |p| {
        let edge = (p.x.min(1.0 - p.x) * 2.3).min(p.y.min(1.0 - p.y) * 3.2);
        let tone = match edge {
            e if (0.10..0.16).contains(&e) || (0.20..0.22).contains(&e) => hex(0xa4552f),
            _ => hex(0xd2c6b1),
        };
        let rib = 0.94 + 0.06 * (p.y * 256.0 * std::f32::consts::PI).sin().abs();
        tone * rib * (0.90 + 0.16 * fractal(p, (40, 56), 3, 97))
    })
}

/// Oak, oiled: a tile of 1 m along the grain (u) × 1 m across.
pub fn oak() -> EncodedImage {
    draw("oak", (512, 512), Codec::Jpeg(84), |p| {
        let warp = fractal(p, (2, 6), 3, 21);
        let rings = (fractal(vec2(p.x, p.y + 0.05 * warp), (1, 10), 3, 23) * 14.0).fract();
        let pores = fractal(p, (6, 160), 2, 29);
        let grain = smoothstep(0.0, 0.75, rings) * (1.0 - smoothstep(0.9, 1.0, rings));
        let color = hex(0x9c6f45).lerp(hex(0xc09468), grain);
        color * (0.88 + 0.16 * warp) * (1.0 - 0.22 * smoothstep(0.62, 0.8, pores))
    })
}

/// Trowelled plaster as a normal map: a tile of 1.5 m × 1.5 m.
pub fn plaster_relief() -> EncodedImage {
    let height = |p: Vec2| 0.010 * fractal(p, (9, 9), 3, 31) + 0.004 * fractal(p, (40, 16), 2, 37);
    relief("plaster relief", (512, 512), height)
}

/// Leather grain as a normal map: a tile of 0.25 m × 0.25 m.
pub fn leather_relief() -> EncodedImage {
    let height = |p: Vec2| 0.012 * fractal(p, (24, 24), 2, 41) + 0.006 * fractal(p, (5, 5), 2, 43);
    relief("leather relief", (128, 128), height)
}

/// Normal map of a height field that repeats.
fn relief(name: &'static str, size: (u32, u32), height: impl Fn(Vec2) -> f32) -> EncodedImage {
    const STEP: f32 = 1.0 / 512.0;
    draw(name, size, Codec::Png, |p| {
        let slope = |axis: Vec2| (height(p + STEP * axis) - height(p - STEP * axis)) / (2.0 * STEP);
        // Rows of an image run down while the bitangent points up.
        let normal = vec3(-slope(Vec2::X), slope(Vec2::Y), 1.0).normalize();
        normal * 0.5 + 0.5
    })
}
