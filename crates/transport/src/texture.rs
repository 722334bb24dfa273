//! Reading textures: wrap modes, filters and the sRGB curve as glTF defines them. v = 0 is the top row, texel centers lie
//! at halves.

use std::sync::LazyLock;

use glam::{Vec2, Vec4};

use crate::scene::{Encoding, Filter, Image, Texture, TextureRef, Wrap};

/// Linear values of the 256 sRGB codes.
static SRGB: LazyLock<[f32; 256]> =
    LazyLock::new(|| std::array::from_fn(|code| srgb_to_linear(code as f64 / 255.0) as f32));

/// The sRGB curve: encoded 0…1 to linear 0…1.
pub fn srgb_to_linear(encoded: f64) -> f64 {
    if encoded <= 0.040_45 { encoded / 12.92 } else { ((encoded + 0.055) / 1.055).powf(2.4) }
}

impl Texture {
    /// Linear RGBA at a texture coordinate; a coordinate that is no number reads as 0.
    pub fn fetch(&self, uv: Vec2, encoding: Encoding) -> Vec4 {
        let size = [self.image.width, self.image.height];
        let [u, v] = [0, 1].map(|axis| fold(uv[axis], self.wrap[axis]));
        match self.filter {
            Filter::Nearest => {
                let [x, y] = [0, 1].map(|axis| (([u, v][axis] * size[axis] as f32) as u32).min(size[axis] - 1));
                decode(&self.image, [x, y], encoding)
            }
            Filter::Linear => {
                let [x, y] = [0, 1].map(|axis| neighbors([u, v][axis], size[axis], self.wrap[axis]));
                let at = |column, row| decode(&self.image, [column, row], encoding);
                let top = at(x.0, y.0).lerp(at(x.1, y.0), x.2);
                let bottom = at(x.0, y.1).lerp(at(x.1, y.1), x.2);
                top.lerp(bottom, y.2)
            }
        }
    }
}

impl TextureRef {
    /// Linear RGBA at the texture coordinates of a point.
    pub fn fetch(&self, textures: &[Texture], uvs: [Vec2; 2]) -> Vec4 {
        let uv = self.transform.transform_point2(uvs[usize::from(self.uv_set.min(1))]);
        textures[self.texture as usize].fetch(uv, self.encoding)
    }
}

/// Brings a coordinate into 0…1.
fn fold(u: f32, wrap: Wrap) -> f32 {
    if !u.is_finite() {
        return 0.0;
    }
    match wrap {
        Wrap::Repeat => u - u.floor(),
        Wrap::Mirror => 1.0 - (u - 2.0 * (0.5 * u).floor() - 1.0).abs(),
        Wrap::Clamp => u.clamp(0.0, 1.0),
    }
}

/// The two texels around a folded coordinate and the weight of the second one.
fn neighbors(u: f32, size: u32, wrap: Wrap) -> (u32, u32, f32) {
    let x = u * size as f32 - 0.5;
    let left = x.floor();
    let weight = x - left;
    let left = left as i32;
    let last = size as i32 - 1;
    let (low, high) = match wrap {
        Wrap::Repeat => (if left < 0 { last } else { left }, if left >= last { 0 } else { left + 1 }),
        // A mirrored neighbor across the border is the border texel itself.
        Wrap::Mirror | Wrap::Clamp => (left.max(0), (left + 1).min(last)),
    };
    (low as u32, high as u32, weight)
}

fn decode(image: &Image, [x, y]: [u32; 2], encoding: Encoding) -> Vec4 {
    let [r, g, b, a] = image.texels[y as usize * image.width as usize + x as usize];
    let unit = |code: u8| f32::from(code) * (1.0 / 255.0);
    match encoding {
        Encoding::Linear => Vec4::new(unit(r), unit(g), unit(b), unit(a)),
        Encoding::Srgb => {
            let table = &*SRGB;
            Vec4::new(table[usize::from(r)], table[usize::from(g)], table[usize::from(b)], unit(a))
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use glam::Affine2;

    use super::*;

    /// Red counts columns, green counts rows.
    fn counted(width: u32, height: u32, wrap: Wrap, filter: Filter) -> Texture {
        let texels = (0..width * height).map(|i| [(i % width) as u8 * 10, (i / width) as u8 * 10, 0, 255]).collect();
        Texture { image: Arc::new(Image { width, height, texels }), wrap: [wrap; 2], filter }
    }

    fn column(texture: &Texture, u: f32) -> f32 {
        texture.fetch(Vec2::new(u, 0.5), Encoding::Linear).x * 25.5
    }

    #[test]
    fn texel_centers_give_the_texel_itself_and_the_first_row_is_at_the_top() {
        for filter in [Filter::Linear, Filter::Nearest] {
            for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
                let texture = counted(4, 3, wrap, filter);
                for (x, y) in (0..3).flat_map(|y| (0..4).map(move |x| (x, y))) {
                    let uv = Vec2::new((x as f32 + 0.5) / 4.0, (y as f32 + 0.5) / 3.0);
                    let texel = texture.fetch(uv, Encoding::Linear) * 25.5;
                    assert!((texel.x - x as f32).abs() < 1e-4 && (texel.y - y as f32).abs() < 1e-4);
                }
            }
        }
    }

    #[test]
    fn between_two_centers_lies_their_mean() {
        let texture = counted(4, 1, Wrap::Clamp, Filter::Linear);
        assert!((column(&texture, 0.5) - 1.5).abs() < 1e-5);
        assert!((column(&texture, 0.3125) - 0.75).abs() < 1e-5);
    }

    #[test]
    fn wrap_modes_tile_mirror_and_hold_the_border() {
        let nearest = |wrap, u| column(&counted(4, 1, wrap, Filter::Nearest), u).round() as i32;
        assert_eq!([-0.1, 1.1, 2.9, -3.9].map(|u| nearest(Wrap::Repeat, u)), [3, 0, 3, 0]);
        assert_eq!([-0.1, 1.1, 1.9, 2.1].map(|u| nearest(Wrap::Mirror, u)), [0, 3, 0, 0]);
        assert_eq!([-0.1, -9.0, 1.1, 7.0].map(|u| nearest(Wrap::Clamp, u)), [0, 0, 3, 3]);
        let linear = |wrap, u| column(&counted(4, 1, wrap, Filter::Linear), u);
        assert!((linear(Wrap::Repeat, 1.0) - 1.5).abs() < 1e-5, "the last texel blends into the first one");
        assert!((linear(Wrap::Mirror, 1.0) - 3.0).abs() < 1e-5);
        assert!((linear(Wrap::Mirror, 1.25) - linear(Wrap::Mirror, 0.75)).abs() < 1e-5);
        assert!((linear(Wrap::Clamp, 1.0) - 3.0).abs() < 1e-5);
    }

    #[test]
    fn hostile_coordinates_give_finite_colors() {
        for wrap in [Wrap::Repeat, Wrap::Mirror, Wrap::Clamp] {
            for filter in [Filter::Linear, Filter::Nearest] {
                let texture = counted(3, 2, wrap, filter);
                for u in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, 1e20, -1e-9, 1.0 - 1e-8] {
                    assert!(texture.fetch(Vec2::splat(u), Encoding::Srgb).is_finite());
                }
            }
        }
    }

    #[test]
    fn the_srgb_curve_meets_known_values_and_leaves_alpha_alone() {
        assert!((srgb_to_linear(0.5) - 0.2140).abs() < 1e-4);
        assert_eq!((srgb_to_linear(0.0), srgb_to_linear(1.0)), (0.0, 1.0));
        let image = Image { width: 1, height: 1, texels: vec![[188, 188, 188, 51]] };
        let texture = Texture { image: Arc::new(image), wrap: [Wrap::Repeat; 2], filter: Filter::Linear };
        let color = texture.fetch(Vec2::ZERO, Encoding::Srgb);
        assert!((color.x - 0.5029).abs() < 1e-4 && (color.w - 0.2).abs() < 1e-6);
    }

    #[test]
    fn a_reference_chooses_its_uv_set_and_applies_its_transform() {
        let textures = [counted(4, 4, Wrap::Repeat, Filter::Nearest)];
        let transform = Affine2::from_translation(Vec2::new(0.25, 0.5));
        let reference = TextureRef { texture: 0, uv_set: 1, transform, encoding: Encoding::Linear };
        let texel = reference.fetch(&textures, [Vec2::ONE * 0.9, Vec2::splat(0.125)]) * 25.5;
        assert!((texel.x - 1.0).abs() < 1e-4 && (texel.y - 2.0).abs() < 1e-4);
    }
}
