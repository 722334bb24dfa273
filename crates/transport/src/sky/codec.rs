//! A map as bytes behind the header of a file: width and height u32, scale f32, three f16 per pixel, FNV-1a u64.

// What is read here was written by strangers, so no integer may wrap in silence.
#![cfg_attr(not(test), deny(clippy::arithmetic_side_effects))]
#![cfg_attr(not(test), deny(clippy::cast_possible_truncation, clippy::cast_sign_loss))]

use clerestory_nystrom::codec::checksum;
use half::f16;

use super::{Averaged, Environment};

/// Widest map that a file keeps, so that the sky behind a picture is as sharp as its map; wider ones are averaged down.
const MAX_STORED_WIDTH: usize = 8192;
/// Brightest value before scaling up to it, well inside the range of f16.
const STORED_PEAK: f32 = 32_768.0;
const HEADER_LEN: usize = 12;
const CHECKSUM_LEN: usize = 8;

impl Environment {
    /// At most `MAX_STORED_WIDTH` pixels wide and rounded to what an archive keeps.
    #[must_use]
    pub fn storable(&self) -> Environment {
        let small = self.reduced(self.width().div_ceil(MAX_STORED_WIDTH));
        let scale = small.scale();
        let round = |v: f32| f16::from_f32(v * scale).to_f32() / scale;
        let pixels = small.pixels().iter().map(|p| p.map(round)).collect();
        Environment::of_clean(small.width(), small.height(), pixels)
    }

    /// Means over squares of `factor` pixels a side; what is left over at the edges is spread over all of them.
    #[expect(clippy::arithmetic_side_effects, reason = "places in a map in memory, which has a pixel at least")]
    fn reduced(&self, factor: usize) -> Environment {
        if factor <= 1 {
            return self.clone();
        }
        let (width, height) = (self.width(), self.height());
        let mut averaged = Averaged::new([width, height], [width.div_ceil(factor), height.div_ceil(factor)]);
        for (idx, pixel) in self.pixels().iter().enumerate() {
            averaged.put(idx % width, idx / width, *pixel);
        }
        averaged.finish().0
    }

    /// A power of two that brings the brightest channel into the range of f16.
    fn scale(&self) -> f32 {
        let peak = self.pixels().iter().flatten().copied().fold(0.0, f32::max);
        if peak > 0.0 { (STORED_PEAK / peak).log2().floor().clamp(-60.0, 60.0).exp2() } else { 1.0 }
    }

    /// Bytes of a [`Environment::storable`] map.
    #[expect(clippy::cast_possible_truncation, reason = "sides of a map of at most `MAX_PIXELS` pixels")]
    pub(crate) fn encode(&self) -> Vec<u8> {
        let scale = self.scale();
        #[expect(clippy::arithmetic_side_effects, reason = "bytes of a map in memory")]
        let mut bytes = Vec::with_capacity(HEADER_LEN + self.pixels().len() * 6 + CHECKSUM_LEN);
        bytes.extend((self.width() as u32).to_le_bytes());
        bytes.extend((self.height() as u32).to_le_bytes());
        bytes.extend(scale.to_le_bytes());
        bytes.extend(self.pixels().iter().flatten().flat_map(|v| f16::from_f32(v * scale).to_le_bytes()));
        bytes.extend(checksum(&bytes).to_le_bytes());
        bytes
    }

    /// Reads the map at the start of `bytes`, and says how many bytes it took; `None` if it is cut off or damaged.
    pub(crate) fn decode(bytes: &[u8]) -> Option<(Environment, usize)> {
        let word = |at: usize| bytes.get(at..)?.first_chunk().copied();
        let (width, height) = (u32::from_le_bytes(word(0)?) as usize, u32::from_le_bytes(word(4)?) as usize);
        let scale = f32::from_le_bytes(word(8)?);
        let is_sound = Environment::is_size(width, height) && scale > 0.0 && scale.is_finite();
        if !is_sound {
            return None;
        }
        #[expect(clippy::arithmetic_side_effects, reason = "`is_size` holds: at most 2^25 pixels")]
        let end = HEADER_LEN + width * height * 6;
        let whole = end.checked_add(CHECKSUM_LEN)?;
        let stored = bytes.get(end..whole)?;
        if stored != checksum(&bytes[..end]).to_le_bytes() {
            return None;
        }
        let value = |b: &[u8]| f16::from_le_bytes([b[0], b[1]]).to_f32() / scale;
        let pixel = |b: &[u8]| [value(b), value(&b[2..]), value(&b[4..])];
        let pixels: Vec<[f32; 3]> = bytes[HEADER_LEN..end].chunks_exact(6).map(pixel).collect();
        let is_clean = pixels.iter().flatten().all(|v| v.is_finite() && *v >= 0.0);
        is_clean.then(|| (Environment::of_clean(width, height, pixels), whole))
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;

    fn map(width: usize) -> Environment {
        Environment::from_fn(width, width / 2, |d| Vec3::new(1e6 * (d.y - 0.9).max(0.0), 0.5 + 0.1 * d.x, 0.25))
    }

    #[test]
    fn a_stored_map_comes_back_bit_by_bit() {
        let stored = map(64).storable();
        let mut bytes = stored.encode();
        let len = bytes.len();
        bytes.extend([1, 2, 3]);
        let (back, read) = Environment::decode(&bytes).unwrap();
        assert_eq!((back.pixels(), read), (stored.pixels(), len));
        assert!(back == stored && stored.storable() == stored);
        for (a, b) in map(64).pixels().iter().zip(back.pixels()) {
            assert!((0..3).all(|c| (a[c] - b[c]).abs() <= 1e-3 * a[c]), "{a:?} {b:?}");
        }
    }

    #[test]
    fn bytes_that_are_no_map_are_refused() {
        let bytes = map(16).storable().encode();
        for at in [0, 5, 9, 20, bytes.len() - 1] {
            let mut broken = bytes.clone();
            broken[at] ^= 0x41;
            assert!(Environment::decode(&broken).is_none(), "byte {at}");
        }
        assert!((0..bytes.len()).all(|n| Environment::decode(&bytes[..n]).is_none()));
        assert!(Environment::decode(&[0xFF; 64]).is_none());
    }

    #[test]
    fn a_wide_map_is_averaged_down_and_keeps_its_directions() {
        let around = |d: Vec3| (d * Vec3::new(1.0, 0.0, 1.0)).normalize();
        let of_width = |width| Environment::from_fn(width, 8, |d| Vec3::splat(2.0 + around(d).x + 0.5 * around(d).z));
        assert_eq!(of_width(8192).storable().width(), 8192);
        let wide = of_width(20_000);
        let small = wide.storable();
        assert!(small.width() <= 8192 && small.width() > 4096);
        for d in [Vec3::X, Vec3::Z, Vec3::new(-0.6, 0.0, 0.8)] {
            assert!((small.radiance(d) - wide.radiance(d)).abs().max_element() < 5e-3, "{d}");
        }
    }
}
