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
/// One at its center.
const AT_CENTER: u32 = 1;
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
    /// The light that a pixel shows, as far as its last look tells.
    lights: Vec<Option<LightSeen>>,
}

/// A light that a pixel shows.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LightSeen {
    /// Its column.
    pub column: u32,
    /// What comes from it for a coefficient of 1: white radiance, tinted on the way.
    pub radiance: Vec3,
    /// Whether it is seen straight, but for clear panes: then there is no other way, and no more of it.
    pub is_straight: bool,
    /// Whether it is a surface that looks alike under all lights, which is nobody's reflection.
    pub is_unlit: bool,
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
    /// The light that the last one sees.
    light: Option<LightSeen>,
}

/// One look: the place where it ends, the first normal, the color on the way and there, whether it sees a light first, and the last
/// light that it sees.
#[derive(Clone, Copy, Default)]
struct Look {
    place: Vec3,
    normal: Vec3,
    color: Vec3,
    shining: f32,
    solid: f32,
    light: Option<LightSeen>,
}

impl Guides {
    /// Looks at every pixel; `None` when `goes_on` said no.
    pub fn new(
        scene: &PreparedScene,
        camera: &Camera,
        film: Film,
        goes_on: &(dyn Fn() -> bool + Sync),
    ) -> Option<Guides> {
        Self::of_looks(LOOKS, (scene, camera), film, goes_on)
    }

    /// The same from a look at the center of each pixel alone.
    pub fn at_centers(
        scene: &PreparedScene,
        camera: &Camera,
        film: Film,
        goes_on: &(dyn Fn() -> bool + Sync),
    ) -> Option<Guides> {
        Self::of_looks(AT_CENTER, (scene, camera), film, goes_on)
    }

    fn of_looks(
        n_looks: u32,
        (scene, camera): (&PreparedScene, &Camera),
        film: Film,
        goes_on: &(dyn Fn() -> bool + Sync),
    ) -> Option<Guides> {
        let at = |x: u32, y: u32| looks(n_looks, (scene, camera), film, [x, y]);
        let row = |y: u32| goes_on().then(|| (0..film.width).map(|x| at(x, y)).collect::<Vec<_>>());
        let rows: Option<Vec<_>> = (0..film.height).into_par_iter().map(row).collect();
        let (pixels, gains): (Vec<Pixel>, Vec<_>) = rows?.into_iter().flatten().unzip();
        let extent = |pixel: usize| {
            let distances = beside(film, pixel).map(|other| pixels[other].place.distance(pixels[pixel].place));
            distances.fold(f32::INFINITY, f32::min).min(1e9)
        };
        let extents = (0..pixels.len()).map(extent).collect();
        Some(Guides::of_pixels(&pixels, gains, extents))
    }

    /// From one look at each of some points of the film, all of them in pixels of these numbers, which these guides are of.
    pub fn at_points(
        &self,
        (scene, camera): (&PreparedScene, &Camera),
        film: Film,
        points: &[(u32, Vec2)],
        goes_on: &(dyn Fn() -> bool + Sync),
    ) -> Option<Guides> {
        let at = |(nth, (_, film_px)): (usize, &(u32, Vec2))| {
            goes_on().then(|| {
                let mut sampler = Sampler::new(0, STREAM + nth as u64, 0);
                of_looks([look(scene, (camera.position(), camera.direction(film, *film_px)), &mut sampler)])
            })
        };
        let looked: Option<Vec<_>> = points.par_iter().enumerate().map(at).collect();
        let (pixels, gains): (Vec<Pixel>, Vec<_>) = looked?.into_iter().unzip();
        let extents = points.iter().map(|(pixel, _)| self.extents[*pixel as usize]).collect();
        Some(Guides::of_pixels(&pixels, gains, extents))
    }

    fn of_pixels(pixels: &[Pixel], gains: Vec<[f32; CHANNELS]>, extents: Vec<f32>) -> Guides {
        let compared = std::array::from_fn(|nth| pixels.iter().map(|pixel| pixel.compared()[nth]).collect());
        let lights = pixels.iter().map(|pixel| pixel.light).collect();
        Guides { compared, extents, gains, lights }
    }
}

/// Pixels beside one, above and below.
pub(crate) fn beside(film: Film, pixel: usize) -> impl Iterator<Item = usize> {
    let width = film.width as usize;
    let (x, y) = (pixel % width, pixel / width);
    let beside = [(x > 0).then(|| pixel - 1), (x + 1 < width).then(|| pixel + 1)];
    let above = [(y > 0).then(|| pixel - width), (y + 1 < film.height as usize).then(|| pixel + width)];
    beside.into_iter().chain(above).flatten()
}

impl Guides {
    /// How alike a pixel and one of another picture of the same scene are, as far as both see a surface: from 0 to 1.
    pub fn likeness_to(&self, bundle: u32, other: &Guides, of_other: u32) -> f32 {
        let [own, other] = [(self, bundle), (other, of_other)]
            .map(|(guides, bundle)| guides.compared.each_ref().map(|plane| plane[bundle as usize]));
        let [x, y, z, nx, ny, nz, shining, _] = own;
        let [away_x, away_y, away_z] = [other[0] - x, other[1] - y, other[2] - z];
        let turn = (other[3] - nx).powi(2) + (other[4] - ny).powi(2) + (other[5] - nz).powi(2);
        let apart = (other[6] - shining).powi(2);
        let reach = STEP_PIXELS * self.extents[bundle as usize] + f32::MIN_POSITIVE;
        let distance = (away_x * away_x + away_y * away_y + away_z * away_z).sqrt();
        let off_plane = (away_x * nx + away_y * ny + away_z * nz) / (reach + SLOPE * distance);
        fallen(turn / (TURN * TURN) + apart / (SHINING * SHINING) + off_plane * off_plane)
    }

    /// The light that a pixel shows, straight or by mirrors and panes.
    pub fn light(&self, bundle: u32) -> Option<LightSeen> {
        self.lights[bundle as usize]
    }

    /// Memory that it takes, bytes.
    pub fn n_bytes(&self) -> usize {
        let numbers = self.compared.iter().chain([&self.extents]).map(|plane| size_of_val(plane.as_slice()));
        numbers.sum::<usize>() + size_of_val(self.gains.as_slice()) + size_of_val(self.lights.as_slice())
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
        let Pixel { place, normal, shining, solid, .. } = self;
        [place.x, place.y, place.z, normal.x, normal.y, normal.z, *shining, *solid]
    }
}

/// Likeness at a difference, squared: `exp(−unlike)` but for a few hundredths, and none from [`FAR`] on. A power takes no call.
fn fallen(unlike: f32) -> f32 {
    let near = (1.0 - unlike / FAR).max(0.0);
    let fourth = (near * near) * (near * near);
    (fourth * fourth) * (fourth * fourth)
}

fn looks(
    n_looks: u32,
    (scene, camera): (&PreparedScene, &Camera),
    film: Film,
    [x, y]: [u32; 2],
) -> (Pixel, [f32; CHANNELS]) {
    of_looks((0..n_looks).map(|nth| {
        let mut sampler = Sampler::new(0, STREAM + u64::from(y * film.width + x), nth);
        let within = Vec2::from(sampler.next_2d());
        let within = if n_looks == AT_CENTER { Vec2::splat(0.5) } else { within };
        let film_px = Vec2::new(x as f32, y as f32) + within;
        look(scene, (camera.position(), camera.direction(film, film_px)), &mut sampler)
    }))
}

/// The mean of looks, as many as there are.
fn of_looks(looks: impl IntoIterator<Item = Look, IntoIter: ExactSizeIterator>) -> (Pixel, [f32; CHANNELS]) {
    let (mut pixel, mut color, looks) = (Pixel::default(), Vec3::ZERO, looks.into_iter());
    let share = 1.0 / looks.len() as f32;
    for look in looks {
        pixel.place += look.place * share;
        pixel.normal += look.normal * share;
        pixel.shining += look.shining * share;
        pixel.solid += look.solid * share;
        pixel.light = look.light;
        color += look.color * share;
    }
    (pixel, (color + COLORLESS).to_array())
}

fn look(scene: &PreparedScene, (origin, direction): (Vec3, Vec3), sampler: &mut Sampler) -> Look {
    let mut ray = Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    let (mut look, mut tint, mut is_straight) = (Look::default(), Vec3::ONE, true);
    for depth in 0..MOST_MIRRORS {
        let Some(hit) = scene.closest_seen(&ray, sampler) else { break };
        let emitted = scene.emitted(&hit, -ray.direction);
        if let Some((column, radiance)) = emitted {
            let is_unlit = is_straight && scene.material(hit.triangle).unlit;
            look.light = Some(LightSeen { column, radiance: radiance * tint, is_straight, is_unlit });
        }
        if depth == 0 {
            look.solid = 1.0;
            look.normal = scene.smooth_normal(&hit, ray.direction);
            look.shining = f32::from(u8::from(emitted.is_some()));
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
        is_straight = false;
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
