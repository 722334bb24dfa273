//! The pictures on the gallery's walls, drawn by formulas.

use std::f32::consts::{FRAC_PI_2, TAU};

use glam::{Vec2, Vec3, vec2};

use crate::glb::EncodedImage;
use crate::textures::{Codec, draw, fractal, hex, random, smoothstep};

/// Bands of hills before a low sun; 4 : 5.
pub fn horizon() -> EncodedImage {
    let hills = [0xe7a977, 0xd9805f, 0xb4555a, 0x7c3f58, 0x472c4c, 0x231d38].map(hex);
    draw("horizon", (512, 512), Codec::Jpeg(88), |p| {
        let mut color = hex(0xf6dfc0).lerp(hex(0xf0b98a), smoothstep(0.0, 0.6, p.y));
        if vec2(p.x - 0.62, (p.y - 0.36) * 1.25).length() < 0.155 {
            color = hex(0xd8452e);
        }
        for (i, hill) in (0_u8..).zip(hills) {
            let i = f32::from(i);
            let wave = (p.x * (3.2 + 0.9 * i) + 1.7 * i).sin() * 0.035 + (p.x * (7.1 - i) + 2.3 * i).sin() * 0.012;
            if p.y > 0.46 + 0.085 * i + wave {
                color = hill;
            }
        }
        paper(p, color)
    })
}

/// Discs that stain one another; 1 : 1.
pub fn orbits() -> EncodedImage {
    let discs = [
        (0.42, 0.40, 0.27, 0xf2b134),
        (0.62, 0.52, 0.22, 0xe4572e),
        (0.38, 0.66, 0.19, 0x17808f),
        (0.70, 0.28, 0.12, 0x274690),
        (0.74, 0.76, 0.09, 0x1b998b),
        (0.20, 0.24, 0.07, 0xd1495b),
    ];
    draw("orbits", (512, 512), Codec::Jpeg(88), |p| {
        let mut color = hex(0xf3ecdf);
        for (x, y, radius, tone) in discs {
            let distance = p.distance(vec2(x, y));
            if distance < radius {
                color *= hex(tone) * 0.88 + 0.12;
            }
            if (distance - radius * 1.22).abs() < 0.0025 {
                color = hex(0x2b2b33);
            }
        }
        paper(p, color)
    })
}

/// Quarter circles on a grid of 4 × 5; 4 : 5.
pub fn quarters() -> EncodedImage {
    let palette = [0x1d3557, 0xe63946, 0xf1c453, 0x457b9d, 0xf4f1de, 0x2a9d8f, 0xf4a261].map(hex);
    draw("quarters", (512, 512), Codec::Png, |p| {
        let q = p * vec2(4.0, 5.0);
        let (column, row) = (q.x as i32, q.y as i32);
        let pick = |seed: u32| (random(column, row, seed) * palette.len() as f32) as usize;
        let (ground, figure) = (pick(7), pick(8));
        let figure = if figure == ground { (figure + 3) % palette.len() } else { figure };
        let corner = (random(column, row, 9) * 4.0) as i32;
        let offset = q.fract() - vec2((corner & 1) as f32, (corner >> 1) as f32);
        let distance = offset.length();
        let core = random(column, row, 10) > 0.5 && distance < 0.45;
        if distance < 0.97 && !core { palette[figure] } else { palette[ground] }
    })
}

/// Threads in a slow current; 1 : 1.
pub fn drift() -> EncodedImage {
    draw("drift", (512, 512), Codec::Jpeg(86), |p| {
        let current = fractal(p * 0.7 + 0.13, (3, 3), 2, 51);
        let level = p.y * 15.0 + current * 16.0;
        let thread = level.floor();
        let across = (level.fract() - 0.5).abs();
        let tone = random(thread as i32, 0, 53);
        let ink = if tone > 0.86 { hex(0xd9683f) } else { hex(0x1f3a5f).lerp(hex(0x6fa3b8), tone) };
        let width = 0.12 + 0.25 * random(thread as i32, 1, 54);
        paper(p, hex(0xf1eadb).lerp(ink, 1.0 - smoothstep(width, width + 0.05, across)))
    })
}

/// Two floating fields of color; 3 : 4.
pub fn fields() -> EncodedImage {
    draw("fields", (512, 512), Codec::Jpeg(88), |p| {
        let cloud = fractal(p, (4, 5), 4, 61) - 0.5;
        let field = |low: f32, high: f32| {
            let edge = 0.03 + 0.05 * (cloud + 0.5);
            let sides = smoothstep(0.05, 0.05 + edge, p.x) * smoothstep(0.05, 0.05 + edge, 1.0 - p.x);
            sides * smoothstep(low, low + edge, p.y) * (1.0 - smoothstep(high - edge, high, p.y))
        };
        let ground = hex(0x6d1a26) * (1.0 + 0.4 * cloud);
        let upper = ground.lerp(hex(0xf08a24) * (1.0 + 0.35 * cloud), 0.95 * field(0.06, 0.56));
        paper(p, upper.lerp(hex(0x2a0f2e) * (1.0 + 0.6 * cloud), 0.92 * field(0.60, 0.95)))
    })
}

/// Strata in teal, coral and gold; 3 : 2, the large piece.
pub fn strata() -> EncodedImage {
    let tones = [0x0b3c49, 0x126e72, 0x3fa7a0, 0xa9d6c9, 0xf5ead6, 0xf2b880, 0xe07a5f, 0xb23a48, 0x5b2333, 0x14283c];
    let tones = tones.map(hex);
    draw("strata", (1024, 1024), Codec::Jpeg(86), |p| {
        let fold = fractal(p * vec2(0.9, 0.6) + 0.05, (3, 2), 3, 71);
        let sway = 0.06 * (p.x * TAU * 0.8 + 0.6).sin() + 0.02 * (p.x * 14.0 + fold * 5.0).sin();
        let level = (p.y + sway) * 7.5 + fold * 5.5;
        let layer = level.floor();
        let tone = tones[(layer as i32).rem_euclid(10) as usize];
        let shade = 1.0 - 0.22 * (level.fract() * FRAC_PI_2).sin().powi(6);
        let vein = if level.fract() < 0.035 { hex(0xd9a441) } else { tone * shade };
        paper(p, vein)
    })
}

/// The tooth of the paper or canvas under a color.
fn paper(p: Vec2, color: Vec3) -> Vec3 {
    color * (0.96 + 0.06 * fractal(p, (96, 96), 2, 81))
}
