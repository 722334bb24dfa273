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

/// Looks at each pixel.
const LOOKS: u32 = 4;
/// Mirrors and panes that a look passes at most.
const MOST_MIRRORS: usize = 8;
/// Streams of random numbers that nobody else uses.
const STREAM: u64 = 1 << 57;
/// Difference of unit normals, and of the share of a pixel that shines, at which likeness falls to 1/e.
const TURN: f32 = 0.3;
const SHINING: f32 = 0.1;
/// Distance from the plane of the other pixel's surface at which it does: in pixels as large as they are there, and a share of the
/// distance between both.
const STEP_PIXELS: f32 = 0.5;
const SLOPE: f32 = 0.1;
/// Differences, in those at which likeness falls to 1/e, squared and added, from which on there is none left.
const FAR: f32 = 8.0;
/// What is added to the color of a surface: coats and metals reflect light that has not its color.
const COLORLESS: f32 = 0.05;

/// What the pixels of a picture show.
pub(crate) struct Guides {
    pixels: Vec<Pixel>,
    gains: Vec<[f32; CHANNELS]>,
}

/// The mean of all looks at a pixel.
#[derive(Clone, Copy, Default)]
struct Pixel {
    /// Where looks end, m.
    place: Vec3,
    /// Normal of the first surface, as it is shaded; shorter where looks differ.
    normal: Vec3,
    /// How far a neighbor's place is at least, m.
    extent: f32,
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
        let (mut pixels, gains): (Vec<Pixel>, Vec<_>) = rows?.into_iter().flatten().unzip();
        let (width, places) = (film.width as usize, pixels.iter().map(|pixel| pixel.place).collect::<Vec<_>>());
        for (at, pixel) in pixels.iter_mut().enumerate() {
            let (x, y) = (at % width, at / width);
            let beside = [(x > 0).then(|| at - 1), (x + 1 < width).then(|| at + 1)];
            let above = [(y > 0).then(|| at - width), (y + 1 < film.height as usize).then(|| at + width)];
            let distances = beside.into_iter().chain(above).flatten().map(|other| places[other].distance(pixel.place));
            pixel.extent = distances.fold(f32::INFINITY, f32::min).min(1e9);
        }
        Some(Guides { pixels, gains })
    }
}

impl Guides {
    /// Memory that it takes, bytes.
    pub fn n_bytes(&self) -> usize {
        size_of_val(self.pixels.as_slice()) + size_of_val(self.gains.as_slice())
    }
}

impl Likeness for Guides {
    fn likeness(&self, bundle: u32, other: u32) -> f32 {
        let (one, other) = (&self.pixels[bundle as usize], &self.pixels[other as usize]);
        let turn = one.normal.distance_squared(other.normal) / (TURN * TURN);
        let apart = (one.shining - other.shining).powi(2) + (one.solid - other.solid).powi(2);
        let unlike = turn + apart / (SHINING * SHINING);
        if unlike > FAR {
            return 0.0;
        }
        let away = other.place - one.place;
        let reach = STEP_PIXELS * one.extent + SLOPE * away.length() + f32::MIN_POSITIVE;
        let off_plane = away.dot(one.normal) / reach;
        (-(off_plane * off_plane + unlike)).exp()
    }

    fn gains(&self, bundle: u32) -> &[f32] {
        &self.gains[bundle as usize]
    }
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
        let Some(hit) = scene.closest(&ray, sampler) else { break };
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
        if scene.material(hit.triangle).is_clear_pane() && through != Vec3::ZERO {
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
            let likeness = guides.likeness(one, other);
            assert!((0.0..=1.0).contains(&likeness), "{one}, {other}: {likeness}");
            assert_eq!(guides.likeness(one, one), 1.0);
            let [a, b] = [one, other].map(|pixel| guides.pixels[pixel as usize].normal);
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
