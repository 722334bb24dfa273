//! What pixels show, told by the scene and not by samples of its light: which of them are expected to look alike.
//!
//! Each pixel is looked at a few times. A look ends where light is scattered broadly: at the first surface, or behind smooth
//! mirrors and glass. Two pixels are alike where their surfaces face the same way and lie in one plane; their light is compared
//! per color of the surface, so that a texture is no difference.

use clerestory_nystrom::Likeness;
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::bsdf::ScatterKind;
use crate::bvh::Ray;
use crate::camera::{Camera, Film};
use crate::matrix::CHANNELS;
use crate::prepared::{PreparedScene, next_after};
use crate::sampler::Sampler;
use crate::streams::Stream;

/// Looks at each pixel.
const LOOKS: u32 = 4;
/// Mirrors and panes that a look passes at most.
const MOST_MIRRORS: usize = 8;
/// Streams of random numbers that nobody else uses.
const STREAM: u64 = Stream::Guides.first();
/// Difference of unit normals, and of the share of a pixel that shines, at which likeness falls to 1/e.
const TURN: f32 = 0.3;
const SHINING: f32 = 0.1;
/// Distance from the plane of the other pixel's surface at which it does: in pixels as large as they are there, and a share of the
/// distance between both.
const STEP_PIXELS: f32 = 0.5;
const SLOPE: f32 = 0.1;
/// Differences, in those at which likeness falls to about 1/e, squared and added, from which on there is none left.
const FAR: f32 = 16.0;
/// What is added to the color of a surface: coats and metals reflect light that has not its color.
const COLORLESS: f32 = 0.05;

/// What the pixels of a picture show.
pub(crate) struct Guides {
    /// What is compared of all pixels, number by number.
    compared: [Vec<f32>; 8],
    /// How far a neighbor's place is at least, m.
    extents: Vec<f32>,
    gains: Vec<[f32; CHANNELS]>,
}

/// The mean of all looks at a pixel.
#[derive(Clone, Copy, Default)]
struct Pixel {
    /// Where looks end, m.
    place: Vec3,
    /// Normal of the first surface, as it is shaded; shorter where looks differ.
    normal: Vec3,
    /// Share of looks that see a light first.
    shining: f32,
    /// Share of looks that meet a surface.
    solid: f32,
}

/// One look: the place where it ends, the first normal, the color on the way and there, and whether it sees a light first.
#[derive(Clone, Copy, Default)]
struct Look {
    place: Vec3,
    normal: Vec3,
    color: Vec3,
    shining: f32,
    solid: f32,
}

impl Guides {
    /// Looks at every pixel; `None` when `goes_on` said no.
    pub fn new(
        scene: &PreparedScene,
        camera: &Camera,
        film: Film,
        goes_on: &(dyn Fn() -> bool + Sync),
    ) -> Option<Guides> {
        let row =
            |y: u32| goes_on().then(|| (0..film.width).map(|x| looks(scene, camera, film, [x, y])).collect::<Vec<_>>());
        let rows: Option<Vec<_>> = (0..film.height).into_par_iter().map(row).collect();
        let (pixels, gains): (Vec<Pixel>, Vec<_>) = rows?.into_iter().flatten().unzip();
        let width = film.width as usize;
        let extent = |(at, pixel): (usize, &Pixel)| {
            let (x, y) = (at % width, at / width);
            let beside = [(x > 0).then(|| at - 1), (x + 1 < width).then(|| at + 1)];
            let above = [(y > 0).then(|| at - width), (y + 1 < film.height as usize).then(|| at + width)];
            let near = beside.into_iter().chain(above).flatten();
            let distances = near.map(|other| pixels[other].place.distance(pixel.place));
            distances.fold(f32::INFINITY, f32::min).min(1e9)
        };
        let extents = pixels.iter().enumerate().map(extent).collect();
        let compared = std::array::from_fn(|nth| pixels.iter().map(|pixel| pixel.compared()[nth]).collect());
        Some(Guides { compared, extents, gains })
    }
}

impl Guides {
    /// Memory that it takes, bytes.
    pub fn n_bytes(&self) -> usize {
        let numbers = self.compared.iter().chain([&self.extents]).map(|plane| size_of_val(plane.as_slice()));
        numbers.sum::<usize>() + size_of_val(self.gains.as_slice())
    }
}

impl Likeness for Guides {
    fn likeness(&self, bundle: u32, first: u32, out: &mut [f32]) {
        let [x, y, z, nx, ny, nz, shining, solid] = self.compared.each_ref().map(|plane| plane[bundle as usize]);
        let others = first as usize..first as usize + out.len();
        let [xs, ys, zs, nxs, nys, nzs, shinings, solids] =
            self.compared.each_ref().map(|plane| &plane[others.clone()]);
        let least_reach = STEP_PIXELS * self.extents[bundle as usize] + f32::MIN_POSITIVE;
        // Without branches, so that several pixels are compared at a time.
        for (at, out) in out.iter_mut().enumerate() {
            let square = |other: f32, own: f32| (other - own) * (other - own);
            let turn = square(nxs[at], nx) + square(nys[at], ny) + square(nzs[at], nz);
            let apart = square(shinings[at], shining) + square(solids[at], solid);
            let away = [xs[at] - x, ys[at] - y, zs[at] - z];
            let distance = (away[0] * away[0] + away[1] * away[1] + away[2] * away[2]).sqrt();
            let off_plane = (away[0] * nx + away[1] * ny + away[2] * nz) / (least_reach + SLOPE * distance);
            *out = fallen(turn / (TURN * TURN) + apart / (SHINING * SHINING) + off_plane * off_plane);
        }
    }

    fn gains(&self, bundle: u32) -> &[f32] {
        &self.gains[bundle as usize]
    }

    fn is_void(&self, bundle: u32) -> bool {
        let [.., solid] = &self.compared;
        solid[bundle as usize] == 0.0
    }
}

impl Pixel {
    /// Place, normal, and what shines and is there.
    fn compared(&self) -> [f32; 8] {
        let Pixel { place, normal, shining, solid } = self;
        [place.x, place.y, place.z, normal.x, normal.y, normal.z, *shining, *solid]
    }
}

/// Likeness at a difference, squared: `exp(−unlike)` but for a few hundredths, and none from [`FAR`] on. A power takes no call.
fn fallen(unlike: f32) -> f32 {
    let near = (1.0 - unlike / FAR).max(0.0);
    let fourth = (near * near) * (near * near);
    (fourth * fourth) * (fourth * fourth)
}

fn looks(scene: &PreparedScene, camera: &Camera, film: Film, [x, y]: [u32; 2]) -> (Pixel, [f32; CHANNELS]) {
    let (mut pixel, mut color) = (Pixel::default(), Vec3::ZERO);
    for nth in 0..LOOKS {
        let mut sampler = Sampler::new(0, STREAM + u64::from(y * film.width + x), nth);
        let film_px = Vec2::new(x as f32, y as f32) + Vec2::from(sampler.next_2d());
        let look = look(scene, (camera.position(), camera.direction(film, film_px)), &mut sampler);
        let share = 1.0 / LOOKS as f32;
        pixel.place += look.place * share;
        pixel.normal += look.normal * share;
        pixel.shining += look.shining * share;
        pixel.solid += look.solid * share;
        color += look.color * share;
    }
    (pixel, (color + COLORLESS).to_array())
}

fn look(scene: &PreparedScene, (origin, direction): (Vec3, Vec3), sampler: &mut Sampler) -> Look {
    let mut ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    let (mut look, mut tint) = (Look::default(), Vec3::ONE);
    for depth in 0..MOST_MIRRORS {
        let Some(hit) = scene.closest_seen(&ray, sampler) else { break };
        if depth == 0 {
            look.solid = 1.0;
            look.normal = scene.smooth_normal(&hit, ray.direction);
            look.shining = f32::from(u8::from(scene.emitted(&hit, -ray.direction).is_some()));
        }
        let base = scene.base_color(&hit);
        (look.place, look.color) = (hit.position, base * tint);
        let bsdf = scene.bsdf(&hit, -ray.direction);
        if scene.has_diffuse_base(&hit) || bsdf.has_smooth_lobes() {
            break;
        }
        let through = bsdf.straight_through();
        if scene.is_clear_pane(hit.triangle) && through != Vec3::ZERO {
            tint *= through;
            ray.t_min = next_after(hit.t);
            continue;
        }
        let Some(sample) = bsdf.sample(sampler.next_1d(), sampler.next_2d()) else { break };
        if sample.kind == ScatterKind::Smooth {
            break;
        }
        tint *= base;
        let outward = hit.outward(-ray.direction);
        let side = if sample.transmitted { -outward } else { outward };
        ray = Ray { origin: hit.origin(side), direction: sample.wi, t_min: 0.0, t_max: f32::INFINITY };
    }
    look
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::import;

    const FILM: Film = Film { width: 32, height: 24 };

    fn guides() -> Guides {
        let bytes = include_bytes!("../../editor/tests/room.gltf");
        let scene = import::load_bytes("room.gltf", bytes).unwrap().scene;
        let scene = PreparedScene::new(scene, &[]).unwrap().0;
        assert!(Guides::new(&scene, &scene.scene.cameras[0], FILM, &|| false).is_none());
        Guides::new(&scene, &scene.scene.cameras[0], FILM, &|| true).unwrap()
    }

    #[test]
    fn pixels_of_one_wall_are_alike_and_those_of_two_walls_are_not() {
        let guides = guides();
        let (mut alike, mut others) = (0, 0);
        for (one, other) in (0..FILM.n_pixels() as u32 - 1).map(|pixel| (pixel, pixel + 1)) {
            let mut likeness = [0.0; 2];
            guides.likeness(one, one, &mut likeness);
            let [own, likeness] = likeness;
            assert!((0.0..=1.0).contains(&likeness), "{one}, {other}: {likeness}");
            assert_eq!(own, 1.0);
            let [a, b] =
                [one, other].map(|pixel| Vec3::from([3, 4, 5].map(|nth| guides.compared[nth][pixel as usize])));
            let (same, turned) = (a.distance(b) < 1e-3 && a.length() > 0.999, a.dot(b) < 0.3);
            assert!(!turned || likeness < 1e-3, "{one}, {other}: {a} {b} {likeness}");
            alike += usize::from(same && likeness > 0.9);
            others += usize::from(turned);
        }
        assert!(alike > 300 && others > 20, "{alike} {others}");
    }

    #[test]
    fn gains_are_colors_and_never_zero() {
        let guides = guides();
        let gains = (0..FILM.n_pixels() as u32).map(|pixel| guides.gains(pixel));
        assert!(gains.flatten().all(|gain| (COLORLESS..=1.0 + COLORLESS + 1e-6).contains(gain)));
    }
}
