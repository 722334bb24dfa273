//! Means over independent walks, and the plainest walk there is.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::bsdf::ScatterKind;
use crate::bvh::Ray;
use crate::camera::Film;
use crate::emitters::Emitter;
use crate::light::LightRig;
use crate::path::{Deposit, Gathering, Integrator, LightPlan, Onto, Pick, Scratch, Vertex};
use crate::prepared::PreparedScene;
use crate::sampler::Sampler;

/// A mean of independent values.
#[derive(Clone, Copy, Debug)]
pub(super) struct Mean {
    pub value: f64,
    /// Standard error.
    pub error: f64,
}

impl Mean {
    /// Of values that are independent of each other.
    pub fn of(values: &[f64]) -> Mean {
        let n = values.len() as f64;
        let value = values.iter().sum::<f64>() / n;
        let variance = values.iter().map(|v| (v - value).powi(2)).sum::<f64>() / (n - 1.0);
        Mean { value, error: (variance / n).sqrt() }
    }

    /// Asserts that the mean is `expected` within four standard errors and rounding (10⁻⁵ of it), and that the standard
    /// error is below `sharpness` of it: a blurred mean could not fail. So no error of more than four times `sharpness` passes.
    #[track_caller]
    pub fn assert_is(&self, expected: f64, sharpness: f64, what: &str) {
        Mean { value: self.value - expected, error: self.error }.assert_is_none(expected, sharpness, what);
    }

    /// The same of a difference that is to be none beside a scale.
    #[track_caller]
    fn assert_is_none(&self, scale: f64, sharpness: f64, what: &str) {
        let [off, error, most] = [self.value, self.error, sharpness * scale].map(|value| 100.0 * value / scale);
        let told = format!("{what}: off by {off:+.3} % ± {error:.3} % of {scale:.6}");
        println!("{told}");
        assert!(self.error < sharpness * scale, "{told}, too blurred: wanted below ± {most:.3} %");
        assert!(self.value.abs() <= 4.0 * self.error + 1e-5 * scale, "{told}: more than four standard errors");
    }
}

/// Asserts that two ways to estimate the same values, stream by stream, agree in the mean as [`Mean::assert_is`] does.
#[track_caller]
pub(super) fn assert_same_mean(values: &[f64], others: &[f64], sharpness: f64, what: &str) {
    assert_eq!(values.len(), others.len(), "{what}: as many values");
    let differences: Vec<f64> = values.iter().zip(others).map(|(a, b)| a - b).collect();
    Mean::of(&differences).assert_is_none(Mean::of(others).value, sharpness, what);
}

/// Independent walks, stream by stream; the streams take turns at the pixels.
#[derive(Clone, Copy)]
pub(super) struct Walks {
    pub film: Film,
    pub streams: u64,
    pub spp: u32,
    pub bounces: Option<u32>,
    pub seed: u64,
}

/// The sum over columns of green radiance, each column weighed.
struct Weighed<'a> {
    weights: &'a [f32],
    sum: f64,
}

impl Deposit for Weighed<'_> {
    fn scattered(&mut self, column: u32, value: Vec3) {
        self.sum += f64::from(value.y * self.weights[column as usize]);
    }

    fn seen(&mut self, column: u32, value: Vec3) {
        self.scattered(column, value);
    }
}

/// Radiance along a ray, given as its origin and direction, with at most so many bounces.
type Walk = fn(&PreparedScene, &[f32], (Vec3, Vec3), u32, &mut Sampler) -> f64;

impl Walks {
    /// The only pixel of a camera.
    pub fn of_one_pixel(streams: u64, bounces: Option<u32>) -> Walks {
        Walks { film: Film { width: 1, height: 1 }, streams, spp: 1, bounces, seed: 1 }
    }

    /// Green radiance under given weights of the columns: the mean of each stream.
    pub fn streams(&self, scene: &PreparedScene, plan: &impl LightPlan, weights: &[f32]) -> Vec<f64> {
        let integrator = Integrator::new(scene, plan, self.bounces);
        let camera = &scene.scene.cameras[0];
        self.each(|pixel, sampler| {
            let mut deposit = Weighed { weights, sum: 0.0 };
            integrator.sample_pixel(camera, self.film, pixel, sampler, &mut Scratch::default(), &mut deposit);
            deposit.sum
        })
    }

    /// The same by light that is shared, as if each pixel had a node of its own: direct light, and what is gathered.
    pub fn gathered(&self, scene: &PreparedScene, plan: &impl LightPlan, weights: &[f32]) -> Vec<f64> {
        self.gathered_by(scene, plan, weights, |integrator, ray, sampler, scratch, deposit| {
            integrator.sample_direct(ray, sampler, scratch, deposit)
        })
    }

    /// Irradiance of what the pixels show in the same two parts.
    pub fn gathered_irradiance(&self, scene: &PreparedScene, plan: &impl LightPlan, weights: &[f32]) -> Vec<f64> {
        self.gathered_by(scene, plan, weights, |integrator, ray, sampler, scratch, deposit| {
            integrator.sample_direct_irradiance(ray, sampler, scratch, deposit)
        })
    }

    /// Irradiance of what the pixels show.
    pub fn irradiance(&self, scene: &PreparedScene, plan: &impl LightPlan, weights: &[f32]) -> Vec<f64> {
        self.gathered_by(scene, plan, weights, |integrator, ray, sampler, scratch, deposit| {
            integrator.sample_seen_irradiance(ray, sampler, scratch, deposit);
            None
        })
    }

    fn gathered_by<P: LightPlan>(
        &self,
        scene: &PreparedScene,
        plan: &P,
        weights: &[f32],
        direct: impl Fn(&Integrator<'_, P>, (Vec3, Vec3), &mut Sampler, &mut Scratch, &mut Weighed) -> Option<Gathering>
        + Sync,
    ) -> Vec<f64> {
        let integrator = Integrator::new(scene, plan, self.bounces);
        let camera = &scene.scene.cameras[0];
        self.each(|pixel, mut sampler| {
            let film_px = Vec2::new(pixel[0] as f32, pixel[1] as f32) + Vec2::from(sampler.next_2d());
            let ray = (camera.position(), camera.direction(self.film, film_px));
            let [mut seen, mut arriving] = [0.0; 2].map(|sum| Weighed { weights, sum });
            let mut scratch = Scratch::default();
            let gathering = direct(&integrator, ray, &mut sampler, &mut scratch, &mut seen);
            let share = gathering.map_or(0.0, |at| {
                let from = (&at.hit, at.normal, Onto::Pixel);
                integrator.gather_indirect(from, &mut sampler, &mut scratch, &mut arriving);
                f64::from(at.albedo.y)
            });
            seen.sum + share * arriving.sum
        })
    }

    /// Asserts that the mean of [`Walks::streams`] is a value, as [`Mean::assert_is`] does with a sharpness.
    #[track_caller]
    pub fn assert_mean(
        &self,
        scene: &PreparedScene,
        plan: &impl LightPlan,
        weights: &[f32],
        (expected, sharpness): (f64, f64),
        what: &str,
    ) {
        Mean::of(&self.streams(scene, plan, weights)).assert_is(expected, sharpness, what);
    }

    /// The same as [`Walks::streams`] by [`plain_walk`]; without a limit of bounces by paths so long that they carry nothing.
    pub fn plain(&self, scene: &PreparedScene, weights: &[f32]) -> Vec<f64> {
        self.walked(scene, weights, plain_walk)
    }

    /// The same by [`connected_walk`].
    pub fn connected(&self, scene: &PreparedScene, weights: &[f32]) -> Vec<f64> {
        self.walked(scene, weights, connected_walk)
    }

    fn walked(&self, scene: &PreparedScene, weights: &[f32], walk: Walk) -> Vec<f64> {
        let camera = &scene.scene.cameras[0];
        self.each(|pixel, mut sampler| {
            let film_px = Vec2::new(pixel[0] as f32, pixel[1] as f32) + Vec2::from(sampler.next_2d());
            let ray = (camera.position(), camera.direction(self.film, film_px));
            walk(scene, weights, ray, self.bounces.unwrap_or(100), &mut sampler)
        })
    }

    fn each(&self, sample: impl Fn([u32; 2], Sampler) -> f64 + Sync) -> Vec<f64> {
        let stream = |stream: u64| {
            let pixel = (stream % self.film.n_pixels() as u64) as u32;
            let pixel = [pixel % self.film.width, pixel / self.film.width];
            let sum: f64 = (0..self.spp).map(|index| sample(pixel, Sampler::new(self.seed, stream, index))).sum();
            sum / f64::from(self.spp)
        };
        (0..self.streams).into_par_iter().map(stream).collect()
    }
}

/// Radiance along a ray by nothing but walking: every surface emits, then scatters into one direction. No light is sampled,
/// nothing is weighed, no roulette ends a walk. A clear pane counts as no surface.
fn plain_walk(
    scene: &PreparedScene,
    weights: &[f32],
    (mut origin, mut direction): (Vec3, Vec3),
    bounces: u32,
    sampler: &mut Sampler,
) -> f64 {
    let (mut throughput, mut sum, mut n_hits) = (Vec3::ONE, 0.0, 0);
    while let Some(hit) = scene.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }, sampler) {
        if let Some((column, radiance)) = scene.emitted(&hit, -direction) {
            sum += f64::from((throughput * radiance).y * weights[column as usize]);
        }
        let bsdf = scene.bsdf(&hit, -direction);
        let Some(sample) = bsdf.sample(sampler.next_1d(), sampler.next_2d()) else { break };
        if sample.kind != ScatterKind::Through || !scene.is_clear_pane(hit.triangle) {
            n_hits += 1;
            if n_hits - 1 > bounces {
                break;
            }
        }
        throughput *= sample.weight;
        let side = if sample.wi.dot(hit.normal) < 0.0 { -hit.normal } else { hit.normal };
        (origin, direction) = (hit.origin(side), sample.wi);
    }
    sum
}

/// Radiance along a ray by next-event estimation alone: every vertex is connected to a point of every light, nothing is weighed,
/// and what a walk meets shines only where no connection could have found it, behind the camera, mirrors and clear glass.
fn connected_walk(
    scene: &PreparedScene,
    weights: &[f32],
    (mut origin, mut direction): (Vec3, Vec3),
    bounces: u32,
    sampler: &mut Sampler,
) -> f64 {
    let (mut throughput, mut sum, mut n_hits, mut alone) = (Vec3::ONE, 0.0, 0, true);
    while let Some(hit) = scene.closest(&Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY }, sampler) {
        if let Some((column, radiance)) = scene.emitted(&hit, -direction).filter(|_| alone) {
            sum += f64::from((throughput * radiance).y * weights[column as usize]);
        }
        let bsdf = scene.bsdf(&hit, -direction);
        let sample = bsdf.sample(sampler.next_1d(), sampler.next_2d());
        let passes = sample.is_some_and(|sample| sample.kind == ScatterKind::Through);
        if !passes || !scene.is_clear_pane(hit.triangle) {
            n_hits += 1;
            if n_hits - 1 > bounces {
                break;
            }
        }
        for (emitter, source) in scene.lighting.emitters.iter().zip(&scene.lighting.basis.sources) {
            let u = glam::Vec2::from(sampler.next_2d());
            let Some((target, normal, area, column, white)) = point_of(scene, emitter, source.columns.start, u) else {
                continue;
            };
            let toward = target - hit.position;
            let wi = toward.normalize();
            let side = if wi.dot(hit.normal) < 0.0 { -hit.normal } else { hit.normal };
            let facing = (-wi.dot(normal)).max(0.0) * area / toward.length_squared();
            let value = throughput * bsdf.eval(wi).0 * white * facing;
            if value != Vec3::ZERO {
                let passed = scene.transmittance(hit.origin(side), target);
                sum += f64::from((value * passed).y * weights[column as usize]);
            }
        }
        let Some(sample) = sample else { break };
        alone = match sample.kind {
            ScatterKind::Smooth => false,
            ScatterKind::Delta => true,
            ScatterKind::Through => alone,
        };
        throughput *= sample.weight;
        let side = if sample.wi.dot(hit.normal) < 0.0 { -hit.normal } else { hit.normal };
        (origin, direction) = (hit.origin(side), sample.wi);
    }
    sum
}

/// A point of a light, uniform over its area: place, normal, area in m², column, radiance.
fn point_of(scene: &PreparedScene, emitter: &Emitter, first: u32, u: Vec2) -> Option<(Vec3, Vec3, f32, u32, Vec3)> {
    match emitter {
        Emitter::Surface(surface) => {
            let point = surface.sample(u);
            let radiance = point.white * scene.shown(point.triangle, point.barycentric);
            Some((point.position, point.normal, surface.area, first, radiance))
        }
        Emitter::Panel(panel) => {
            let area = panel.texel_area * (panel.resolution * panel.resolution) as f32;
            Some((panel.point(u), panel.normal, area, first + panel.texel(u), Vec3::ONE))
        }
        _ => None,
    }
}

/// The light of the file as one weight per column.
pub(super) fn file_light(scene: &PreparedScene) -> Vec<f32> {
    scene.lighting.basis.project(&LightRig::default()).into_iter().map(|rgb| rgb[1]).collect()
}

/// Picks every column alike: `rate` times in the mean at every vertex. 0 leaves all to emitters that walks meet.
pub(super) struct Even {
    pub n_cols: u32,
    pub rate: f32,
    pub splits: u32,
}

impl LightPlan for Even {
    fn later(&self, _: Vec3, _: impl FnOnce() -> f32) -> Vertex {
        Vertex::Later
    }

    fn pick(&self, _: Vertex, sampler: &mut Sampler, picks: &mut Vec<Pick>) {
        picks.clear();
        for column in 0..self.n_cols {
            let n = (self.rate + sampler.next_1d()).floor() as usize;
            picks.extend([Pick { column, inverse_rate: 1.0 / self.rate }].iter().cycle().take(n));
        }
    }

    fn rate(&self, _: Vertex, _: u32) -> f32 {
        self.rate
    }

    fn splits(&self) -> u32 {
        self.splits
    }

    fn worth(&self, _: u32) -> f32 {
        f32::INFINITY
    }
}

/// Another plan, but every later vertex is of one kind.
pub(super) struct Always<'a, P> {
    pub plan: &'a P,
    pub later: Vertex,
}

impl<P: LightPlan> LightPlan for Always<'_, P> {
    fn later(&self, _: Vec3, _: impl FnOnce() -> f32) -> Vertex {
        self.later
    }

    fn pick(&self, vertex: Vertex, sampler: &mut Sampler, picks: &mut Vec<Pick>) {
        self.plan.pick(vertex, sampler, picks);
    }

    fn rate(&self, vertex: Vertex, column: u32) -> f32 {
        self.plan.rate(vertex, column)
    }

    fn splits(&self) -> u32 {
        self.plan.splits()
    }

    fn worth(&self, column: u32) -> f32 {
        self.plan.worth(column)
    }
}
