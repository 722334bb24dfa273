//! The path integrator: light is followed from the camera, and every column collects what comes from its own light.
//!
//! One walk serves all columns at once. At each vertex with a lobe that is not a mirror, light sources are sampled (which,
//! and how many, a [`LightPlan`] says), and emitters that the walk meets by itself are weighed against that with the power
//! heuristic \[Veach1995\]. The first such vertex connects to every column, later ones to a few, stratified.

mod caustics;
mod gather;
mod irradiance;
mod lamps;
mod landings;
mod plates;
mod reuse;
mod sky;
mod slabs;

pub(crate) use gather::{Gathering, Onto};
pub(crate) use irradiance::Receiver;
pub(crate) use landings::{Landing, NoLights, Onward};
pub(crate) use reuse::{Meeting, Start};
pub(crate) use slabs::{Emerged, passed_along, through_glass};

use std::ops::Range;

use glam::{Vec2, Vec3};

use caustics::Guides;
use plates::{BATCH, Batch, Onlooker, Points};

use crate::bake::focus::Focus;
use crate::basis::SourceKind;
use crate::bsdf::{Bsdf, BsdfSample, ScatterKind};
use crate::bvh::Ray;
use crate::camera::{Camera, Film};
use crate::casters::Casters;
use crate::emitters::{Emitter, Plate, SurfacePoint, punctual_falloff};
use crate::lamps::Body;
use crate::prepared::{PreparedScene, SurfaceHit};
use crate::sampler::Sampler;
use crate::scene::PunctualKind;
use crate::sky::DomeEmitter;
use crate::slabs::Passage;

/// Takes what a walk finds. Values are radiance per unit of the column's light, RGB.
pub trait Deposit {
    /// Light of a column that was scattered on its way.
    fn scattered(&mut self, column: u32, value: Vec3);
    /// Light of an emitter that the camera sees directly, in mirrors or through glass.
    fn seen(&mut self, column: u32, value: Vec3);
    /// Whether [`Deposit::known`] can ever answer.
    const KNOWS: bool = false;
    /// Takes what a surface scatters, where the light that it receives is known; false where it is not.
    fn known(&mut self, _at: &KnownAt<'_>) -> bool {
        false
    }
}

/// A surface that asks for the light it receives.
pub struct KnownAt<'a> {
    /// Where.
    pub hit: &'a SurfaceHit,
    /// Unit normal on the viewer's side, without normal map.
    pub normal: Vec3,
    /// What multiplies the mean radiance, weighed by the cosine, that arrives there.
    pub weight: Vec3,
    /// Density per solid angle with which the walk came this way: the more, the finer what it would see.
    pub density: f32,
}

/// Where on a walk light sources are sampled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Vertex {
    /// The first vertex with a lobe that is not a mirror.
    First,
    /// A later one to which a few picks would bring too much each.
    Close,
    /// Every other later one.
    Later,
}

/// A column to connect to.
#[derive(Clone, Copy, Debug)]
pub struct Pick {
    /// The column.
    pub column: u32,
    /// One over the expected number of picks of this column.
    pub inverse_rate: f32,
}

/// Chooses the columns that a vertex connects to.
pub trait LightPlan: Sync {
    /// Which kind of later vertex a point is: `peak` is the greatest product of throughput and `f·|cosθ|`, 1/sr.
    fn later(&self, position: Vec3, peak: impl FnOnce() -> f32) -> Vertex;
    /// The picks of a kind of vertex that always has the same, those of [`Vertex::Close`]: every column once.
    fn all(&self, _vertex: Vertex) -> Option<&[Pick]> {
        None
    }
    /// Fills `picks`.
    fn pick(&self, vertex: Vertex, sampler: &mut Sampler, picks: &mut Vec<Pick>);
    /// Expected number of picks of a column.
    fn rate(&self, vertex: Vertex, column: u32) -> f32;
    /// Continuations from the first vertex.
    fn splits(&self) -> u32;
    /// One over the radiance of a column below which a connection is left to roulette; infinite for none.
    fn worth(&self, column: u32) -> f32;
    /// Peaks of a column, of a common one, that radiance 1 is; `None` where nobody has measured them.
    fn peaks(&self) -> Option<f32> {
        None
    }
}

/// [`LightPlan::peaks`] where they are not known.
const UNKNOWN_PEAKS: f32 = 32.0;

/// Follows walks through a scene.
pub struct Integrator<'a, P> {
    scene: &'a PreparedScene,
    plan: &'a P,
    bounces: u32,
    columns: Vec<ColumnPlace>,
    /// The lights of columns that are sampled many at a time.
    plates: Vec<Option<Plate>>,
    /// Those of vertices that connect to all columns, in the order of the plan; `None` where others are among them.
    batches: Vec<Option<Batch>>,
    /// Walks that leave the first surface of a pixel that shares them.
    scouts: u32,
    /// Whether pixels share walks from and to coated surfaces.
    coats_share: bool,
    /// Sources that shine where a walk meets no surface.
    beyond: Vec<u32>,
    /// Columns of patches of the sky, and what shines there.
    dome: Option<(Range<u32>, &'a DomeEmitter)>,
    /// Bodies of free lamps, by column.
    bodies: Vec<(u32, Body)>,
    far: f32,
    /// Peaks of a column, of a common one, that radiance 1 is.
    peaks: f32,
    /// Where walks are sent toward mirrors and clear bodies.
    casters: Option<&'a Casters>,
    /// Who wants to know, if that can change.
    focus: Option<&'a Focus>,
    /// Whether pixels are seen at their centers alone.
    sees_centers: bool,
}

/// Where the light of a column comes from.
#[derive(Clone, Copy)]
struct ColumnPlace {
    /// Source of the basis.
    source: u32,
    /// Texel of a panel along u and v, else 0.
    texel: [u16; 2],
}

impl ColumnPlace {
    /// A point of the texel, in texels from the panel's origin.
    fn texel(self, u: Vec2) -> Vec2 {
        Vec2::new(f32::from(self.texel[0]), f32::from(self.texel[1])) + u
    }
}

/// Buffers of a thread, reused from walk to walk.
#[derive(Default)]
pub struct Scratch {
    picks: Vec<Pick>,
    /// Later connections that carried light, and those of them that roulette left out.
    pub(crate) later: [u64; 2],
}

/// A walk between two vertices.
#[derive(Clone, Copy)]
struct Walk {
    origin: Vec3,
    direction: Vec3,
    throughput: Vec3,
    /// One over the number of walks that share the first vertex; a part of `throughput`.
    share: f32,
    /// Solid-angle density of `direction` times the number of continuations; 0 after a mirror and at the camera.
    density: f32,
    /// Length from where `density` was chosen to the origin, through clear panes.
    passed: f32,
    /// Where `density` was chosen.
    departed: Vec3,
    /// Slabs that were passed since.
    passage: Passage,
    /// Where light was sampled last, `None` while only mirrors and clear glass were met.
    sampled_at: Option<Vertex>,
    /// Solid-angle density with which the last broad lobe was left, infinite before that.
    sharpness: f32,
    /// Where `density` was chosen, a vertex that also sampled light.
    rival: Option<Vertex>,
    /// Nothing has turned it from the camera's ray.
    straight: bool,
    /// Every scattering so far was by a mirror or clear glass.
    specular: bool,
    /// Surfaces met.
    n_hits: u32,
    /// Surfaces that lie between the camera and the one where it set out, and count as bounces like those that it met.
    n_before: u32,
    /// Extinction of the solid that the walk is in, 1/m.
    extinction: Vec3,
    /// Guided walks that left the same place, while its next surface is not met; see [`caustics`].
    guides: Guides,
    /// Share of the light at the end of casters that falls to this walk.
    caustic_share: f32,
}

/// A point on a light as seen from a vertex.
#[derive(Clone, Copy)]
struct LightPoint {
    target: Vec3,
    wi: Vec3,
    /// Radiance per unit of the column over the density of the sample: multiplies `f · cosθ`.
    factor: Vec3,
    /// One over the solid-angle density, 0 for lights without size.
    spread_sr: f32,
    /// Whether it shines from infinitely far away.
    beyond: bool,
    /// About how bright the baked sky is there, nit, for as much light as `factor` has; 0 of any other light.
    shining: f32,
}

/// Surfaces after which roulette begins.
const ROULETTE_AFTER: u32 = 2;
/// Highest probability of going on.
const ROULETTE_MAX: f32 = 0.95;
/// Share of what a walk set out with below which roulette begins on casters.
const EXPENDABLE_ON_CASTERS: f32 = 1.0 / 16.0;

/// Squared difference of unit vectors below which glass has not turned a ray.
const STRAIGHT: f32 = 1e-10;

impl<'a, P: LightPlan> Integrator<'a, P> {
    /// `bounces` counts scattering events beyond the first, as Cycles does; `None` leaves the end to roulette.
    pub fn new(scene: &'a PreparedScene, plan: &'a P, bounces: Option<u32>) -> Self {
        let basis = &scene.lighting.basis;
        let places = basis.sources.iter().enumerate().flat_map(|(idx, source)| {
            let side = match source.kind {
                SourceKind::Panel { resolution, .. } => resolution,
                _ => 1,
            };
            let texel = move |nth: u32| [(nth % side) as u16, (nth / side) as u16];
            (0..source.columns.len() as u32).map(move |nth| ColumnPlace { source: idx as u32, texel: texel(nth) })
        });
        let columns: Vec<ColumnPlace> = places.collect();
        let of_column = columns.iter().map(|place| (place.source, place.texel));
        let plates = plates::of_columns(&scene.lighting.emitters, of_column);
        let all = plan.all(Vertex::Close).unwrap_or_default();
        let batches = all.chunks(BATCH).map(|picks| Batch::of(picks, &plates)).collect();
        let (beyond, bodies) = (sky::sources_beyond(&scene.lighting), lamps::bodies(&scene.lighting));
        let (far, scouts) = (4.0 * scene.diameter(), reuse::scouts(scene, plan));
        let (bounces, dome) = (bounces.unwrap_or(u32::MAX), scene.lighting.dome());
        let (casters, focus, coats_share) = (scene.casters.as_deref(), None, reuse::coats_share(scene, plan));
        let peaks = plan.peaks().unwrap_or(UNKNOWN_PEAKS);
        Integrator {
            scene,
            plan,
            bounces,
            columns,
            plates,
            batches,
            scouts,
            coats_share,
            beyond,
            dome,
            bodies,
            far,
            peaks,
            casters,
            focus,
            sees_centers: false,
        }
    }

    /// The same for somebody who may leave: from then on every ray meets nothing, so that all walks end.
    pub(crate) fn watched(self, focus: &'a Focus) -> Self {
        Integrator { focus: Some(focus), ..self }
    }

    /// The same for pixels that are seen at their centers alone.
    pub(crate) fn of_centers(self) -> Self {
        Integrator { sees_centers: true, ..self }
    }

    /// The point of a pixel with this corner through which a sample looks.
    pub(crate) fn film_px(&self, corner: Vec2, sampler: &mut Sampler) -> Vec2 {
        let within = Vec2::from(sampler.next_2d());
        corner + if self.sees_centers { Vec2::splat(0.5) } else { within }
    }

    /// The same without walks that are sent to mirrors and glass.
    pub(crate) fn unguided(self) -> Self {
        Integrator { casters: None, ..self }
    }

    /// Nearest surface along a ray, as long as somebody wants to know.
    fn closest(&self, ray: &Ray, sampler: &mut Sampler) -> Option<SurfaceHit> {
        if self.focus.is_some_and(Focus::is_left) { None } else { self.scene.closest(ray, sampler) }
    }

    /// The same along a ray of the camera.
    fn closest_seen(&self, ray: &Ray, sampler: &mut Sampler) -> Option<SurfaceHit> {
        if self.focus.is_some_and(Focus::is_left) { None } else { self.scene.closest_seen(ray, sampler) }
    }

    /// The same along rays of the camera, as many as there are samplers.
    fn closest_seen16(
        &self,
        origin: Vec3,
        directions: &[Vec3; 16],
        samplers: &mut [Sampler],
    ) -> [Option<SurfaceHit>; 16] {
        let is_left = self.focus.is_some_and(Focus::is_left);
        if is_left { [None; 16] } else { self.scene.closest_seen16(origin, directions, samplers) }
    }

    /// The scene of the walks.
    pub(crate) fn scene(&self) -> &'a PreparedScene {
        self.scene
    }

    /// Whether walks are sent to mirrors and glass, if there are any that throw light.
    pub(crate) fn is_guided(&self) -> bool {
        self.casters.is_some()
    }

    /// Scattering events beyond the first at most.
    pub(crate) fn bounces(&self) -> u32 {
        self.bounces
    }

    /// One sample of a pixel, all columns: of a random point of its square, unless it is seen at its center alone.
    pub fn sample_pixel(
        &self,
        camera: &Camera,
        film: Film,
        pixel: [u32; 2],
        mut sampler: Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let film_px = self.film_px(Vec2::new(pixel[0] as f32, pixel[1] as f32), &mut sampler);
        let walk = Walk::from_camera(camera.position(), camera.direction(film, film_px));
        self.follow(walk, &mut sampler, scratch, deposit);
    }

    /// Up to 16 samples of a pixel, each as [`Integrator::sample_pixel`] takes it with its own random numbers, whose first rays go
    /// together. As many as there are samplers, and deposits.
    pub(crate) fn sample_pixel16<D: Deposit>(
        &self,
        camera: &Camera,
        film: Film,
        pixel: [u32; 2],
        samplers: &mut [Sampler],
        scratch: &mut Scratch,
        deposits: &mut [D],
    ) {
        assert_eq!(samplers.len(), deposits.len(), "each sample has random numbers and a deposit");
        let (corner, origin) = (Vec2::new(pixel[0] as f32, pixel[1] as f32), camera.position());
        let mut directions = [Vec3::ZERO; 16];
        for (direction, sampler) in directions.iter_mut().zip(samplers.iter_mut()) {
            *direction = camera.direction(film, self.film_px(corner, sampler));
        }
        let hits = self.closest_seen16(origin, &directions, samplers);
        let samples = samplers.iter_mut().zip(deposits);
        for ((direction, hit), (sampler, deposit)) in directions.into_iter().zip(hits).zip(samples) {
            let mut walk = Walk::from_camera(origin, direction);
            if let Some(hit) = self.arrive_at_next(&mut walk, hit, sampler, deposit)
                && self.go_on(&mut walk, &hit, sampler, scratch, deposit)
            {
                self.follow(walk, sampler, scratch, deposit);
            }
        }
    }

    /// One sample of a pixel that sees nothing: only what shines beyond all surfaces.
    pub(crate) fn sample_empty_pixel(
        &self,
        camera: &Camera,
        film: Film,
        pixel: [u32; 2],
        mut sampler: Sampler,
        deposit: &mut impl Deposit,
    ) {
        if !self.beyond.is_empty() || !self.bodies.is_empty() {
            let film_px = self.film_px(Vec2::new(pixel[0] as f32, pixel[1] as f32), &mut sampler);
            self.pass_by((camera.position(), camera.direction(film, film_px)), deposit);
        }
    }

    /// A ray of the camera that meets no surface.
    pub(crate) fn pass_by(&self, (origin, direction): (Vec3, Vec3), deposit: &mut impl Deposit) {
        let walk = Walk::from_camera(origin, direction);
        self.collect_bodies(&walk, f32::INFINITY, deposit);
        self.collect_beyond(&walk, deposit);
    }

    fn follow(&self, mut walk: Walk, sampler: &mut Sampler, scratch: &mut Scratch, deposit: &mut impl Deposit) {
        while let Some(hit) = self.arrive(&mut walk, sampler, deposit) {
            if !self.go_on(&mut walk, &hit, sampler, scratch, deposit) {
                return;
            }
        }
    }

    /// Connects a surface to the lights and scatters the walk there; false where it ends.
    fn go_on<D: Deposit>(
        &self,
        walk: &mut Walk,
        hit: &SurfaceHit,
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut D,
    ) -> bool {
        let bsdf = self.scene.bsdf(hit, -walk.direction);
        if D::KNOWS
            && let Some(goes_on) = self.hand_over(walk, (hit, &bsdf), sampler, scratch, deposit)
        {
            return goes_on;
        }
        self.go_on_from(walk, (hit, &bsdf), sampler, scratch, deposit)
    }

    /// The same on a surface that scatters as told.
    #[inline]
    fn go_on_from(
        &self,
        walk: &mut Walk,
        (hit, bsdf): (&SurfaceHit, &Bsdf),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) -> bool {
        let mut splits = 1;
        if bsdf.has_smooth_lobes() && !self.is_spent(walk) {
            if walk.sampled_at.is_none() {
                splits = self.plan.splits();
                self.connect_first(walk, splits, (hit, bsdf), sampler, scratch, deposit);
            } else {
                let peak = || walk.throughput.max_element() * bsdf.peak_estimate();
                let vertex = self.plan.later(hit.position, peak);
                self.connect(walk, (vertex, Rivals::All { splits: 1 }), (hit, bsdf), sampler, scratch, deposit);
                walk.sampled_at = Some(vertex);
            }
            walk.guides = self.guide_walks(walk, splits, (hit, bsdf), sampler, scratch, deposit);
        }
        // All continuations but the last are walks of their own.
        for split in 1..splits {
            let (mut branch, mut own) = (*walk, sampler.fork(split, splits));
            if self.scatter(&mut branch, hit, bsdf, splits, &mut own) {
                self.follow(branch, &mut own, scratch, deposit);
            }
        }
        if splits > 1 {
            *sampler = sampler.fork(0, splits);
        }
        self.scatter(walk, hit, bsdf, splits, sampler)
    }

    /// Connects the first vertex of a walk, which becomes one of `splits`, to the lights.
    fn connect_first(
        &self,
        walk: &mut Walk,
        splits: u32,
        (hit, bsdf): (&SurfaceHit, &Bsdf),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        self.connect(walk, (Vertex::First, Rivals::All { splits }), (hit, bsdf), sampler, scratch, deposit);
        walk.sampled_at = Some(Vertex::First);
        walk.throughput /= splits as f32;
        walk.share /= splits as f32;
    }

    /// Goes to the next surface and collects what it emits; `None` where the walk ends.
    fn arrive(&self, walk: &mut Walk, sampler: &mut Sampler, deposit: &mut impl Deposit) -> Option<SurfaceHit> {
        let ray = walk.ray();
        let hit = if walk.specular { self.closest_seen(&ray, sampler) } else { self.closest(&ray, sampler) };
        self.arrive_at_next(walk, hit, sampler, deposit)
    }

    /// The same where it is known which one that is.
    fn arrive_at_next(
        &self,
        walk: &mut Walk,
        hit: Option<SurfaceHit>,
        sampler: &mut Sampler,
        deposit: &mut impl Deposit,
    ) -> Option<SurfaceHit> {
        self.collect_bodies(walk, hit.as_ref().map_or(f32::INFINITY, |hit| hit.t), deposit);
        let Some(hit) = hit else {
            self.collect_beyond(walk, deposit);
            return None;
        };
        self.meet(walk, hit, sampler, deposit)
    }

    /// The same at the surface that is the next one.
    fn meet(
        &self,
        walk: &mut Walk,
        hit: SurfaceHit,
        sampler: &mut Sampler,
        deposit: &mut impl Deposit,
    ) -> Option<SurfaceHit> {
        walk.n_hits += 1;
        if walk.extinction != Vec3::ZERO {
            walk.throughput *= (-walk.extinction * hit.t).exp();
        }
        self.share_caustic(walk, &hit, |walk| self.collect_emission(walk, &hit, deposit));
        let material = self.scene.material(hit.triangle);
        if material.unlit || (self.is_spent(walk) && !self.scene.is_clear_pane(hit.triangle)) {
            return None;
        }
        // Roulette: a walk that carries little goes on seldom, and then carries more.
        if walk.n_hits > ROULETTE_AFTER {
            let survival = (walk.throughput.max_element() / (walk.share * self.expendable(&hit))).min(ROULETTE_MAX);
            if sampler.next_1d() >= survival {
                return None;
            }
            walk.throughput /= survival;
        }
        Some(hit)
    }

    /// What a walk may carry of its share at a surface and still be left to roulette. From a caster it may come to a lamp that
    /// no connection finds, so that what roulette makes of a faint walk would be one bright speck.
    fn expendable(&self, hit: &SurfaceHit) -> f32 {
        let throws = self.casters.is_some_and(|casters| casters.has(hit.triangle));
        if throws { EXPENDABLE_ON_CASTERS } else { 1.0 }
    }

    /// Whether a walk has met one surface more than it may scatter at: only a clear pane still lets it pass.
    fn is_spent(&self, walk: &Walk) -> bool {
        walk.n_before + walk.n_hits - 1 > self.bounces
    }

    fn collect_emission(&self, walk: &Walk, hit: &SurfaceHit, deposit: &mut impl Deposit) {
        let Some((column, radiance)) = self.scene.emitted(hit, -walk.direction) else { return };
        let emitter = &self.scene.lighting.emitters[self.columns[column as usize].source as usize];
        let area = match emitter {
            Emitter::Surface(surface) => surface.area,
            Emitter::Panel(panel) => panel.texel_area,
            _ => return deposit.scattered(column, walk.carried() * radiance),
        };
        if walk.specular {
            return deposit.seen(column, walk.carried() * radiance);
        }
        let weight = match walk.rival {
            Some(vertex) if walk.density > 0.0 => self.closeness(walk, hit.t, hit.position).map_or(1.0, |closeness| {
                let pdf = 1.0 / (hit.normal.dot(walk.direction).abs() * area * closeness);
                power_heuristic(walk.density, self.plan.rate(vertex, column) * pdf)
            }),
            _ => 1.0,
        };
        deposit.scattered(column, walk.carried() * radiance * weight);
    }

    /// Samples a direction to go on; false where the walk is absorbed.
    fn scatter(&self, walk: &mut Walk, hit: &SurfaceHit, bsdf: &Bsdf, splits: u32, sampler: &mut Sampler) -> bool {
        sampled(bsdf, sampler).is_some_and(|sample| self.leave(walk, hit, &sample, splits))
    }

    /// Sends a walk on in a sampled direction, one of `splits` continuations; false where nothing is left of it.
    fn leave(&self, walk: &mut Walk, hit: &SurfaceHit, sample: &BsdfSample, splits: u32) -> bool {
        walk.throughput *= sample.weight;
        if walk.throughput.max_element() <= 0.0 {
            return false;
        }
        if sample.kind != ScatterKind::Smooth || sample.transmitted {
            walk.guides = Guides::None;
        }
        if sample.kind == ScatterKind::Through && self.scene.is_clear_pane(hit.triangle) {
            // As shadow rays see it: the same path, a little dimmer, and no surface that counts.
            walk.passed += hit.t;
            walk.n_hits -= 1;
        } else if self.is_spent(walk) {
            return false;
        } else {
            self.turn(walk, hit, sample, splits);
        }
        walk.straight &= (sample.wi - walk.direction).length_squared() < STRAIGHT;
        walk.direction = sample.wi;
        let inside = sample.wi.dot(hit.normal) < 0.0;
        walk.origin = hit.origin(if inside { -hit.normal } else { hit.normal });
        if sample.transmitted && self.scene.attenuates {
            walk.extinction = self.scene.extinction_behind(hit.triangle, !inside, walk.extinction);
        }
        true
    }

    /// Notes how a walk got its new direction.
    fn turn(&self, walk: &mut Walk, hit: &SurfaceHit, sample: &BsdfSample, splits: u32) {
        if sample.kind == ScatterKind::Smooth {
            walk.density = sample.pdf * splits as f32;
            walk.sharpness = sample.pdf;
            walk.specular = false;
            walk.departed = hit.position;
            walk.passage = Passage::default();
        } else if sample.transmitted && self.scene.slabs.pass(&mut walk.passage, hit.triangle) {
            // Connections pass slabs as well.
            return;
        } else {
            walk.density = 0.0;
        }
        walk.rival = walk.sampled_at;
        walk.passed = 0.0;
    }

    /// Extinction of what lies before or behind a surface that a walk met, wherever a direction leads, 1/m.
    fn extinction_towards(&self, walk: &Walk, hit: &SurfaceHit, direction: Vec3) -> Vec3 {
        let back = hit.normal.dot(walk.direction) >= 0.0;
        let before = (direction.dot(hit.normal) > 0.0) != back;
        if before { walk.extinction } else { self.scene.extinction_behind(hit.triangle, back, walk.extinction) }
    }

    /// Next-event estimation: connects a vertex to the columns that the plan picks.
    fn connect(
        &self,
        walk: &Walk,
        (vertex, rivals): (Vertex, Rivals),
        (hit, bsdf): (&SurfaceHit, &Bsdf),
        sampler: &mut Sampler,
        scratch: &mut Scratch,
        deposit: &mut impl Deposit,
    ) {
        let all = self.plan.all(vertex);
        if all.is_none() {
            self.plan.pick(vertex, sampler, &mut scratch.picks);
        }
        let jitter = sampler.next_2d().map(bits_of);
        let roulette = bits_of(sampler.next_1d());
        let outward = hit.outward(-walk.direction);
        let joint = Joint { walk, vertex, rivals, hit, bsdf, outward, jitter, roulette };
        // The weights of many lights at once know nothing of a solid that attenuates around the surface.
        let onlooker = if walk.extinction == Vec3::ZERO { joint.onlooker() } else { None };
        let mut fan = Fan::new(hit.origin(outward));
        let Scratch { picks, later } = scratch;
        for (nth, picks) in all.unwrap_or(picks).chunks(BATCH).enumerate() {
            let first = (nth * BATCH) as u32;
            let own = onlooker.as_ref().filter(|_| all.is_none()).and_then(|_| Batch::of(picks, &self.plates));
            let batch = if all.is_some() { self.batches[nth].as_ref() } else { own.as_ref() };
            if let Some((onlooker, batch)) = onlooker.as_ref().zip(batch) {
                let points = batch.points(onlooker, first);
                self.connect_batch(&joint, (first, picks), &points, &mut fan, later, deposit);
                if batch.is_full() && self.scene.slabs.is_empty() {
                    continue;
                }
            }
            for (slot, pick) in picks.iter().enumerate() {
                let numbered = (first + slot as u32, *pick);
                if onlooker.is_none() || batch.is_none_or(|batch| !batch.holds(slot)) {
                    self.connect_one(&joint, numbered, &mut fan, later, deposit);
                } else if !self.scene.slabs.is_empty() {
                    self.connect_behind_slabs(&joint, numbered, None, deposit);
                }
            }
        }
        fan.flush(self, deposit);
    }

    /// Connects a surface to points whose weights are known.
    fn connect_batch(
        &self,
        joint: &Joint<'_>,
        (first, picks): (u32, &[Pick]),
        points: &Points,
        fan: &mut Fan,
        later: &mut [u64; 2],
        deposit: &mut impl Deposit,
    ) {
        later[0] += u64::from(points.lit.count_ones()) * u64::from(joint.vertex != Vertex::First);
        let mut lit = points.lit;
        while lit != 0 {
            let slot = lit.trailing_zeros() as usize;
            lit &= lit - 1;
            let (value, column) = (points.arriving(slot), picks[slot].column);
            match self.worth_it(joint, value, first + slot as u32, column, 0.0) {
                Some(value) => fan.push(self, points.position(slot), column, value, deposit),
                None => later[1] += 1,
            }
        }
    }

    /// Roulette: a later connection that carries little is seldom asked for, and then carries more.
    #[inline]
    fn worth_it(&self, joint: &Joint<'_>, value: Vec3, nth: u32, column: u32, shining: f32) -> Option<Vec3> {
        if joint.vertex == Vertex::First {
            return Some(value);
        }
        let of_map = if shining > 0.0 {
            self.dome.as_ref().map_or(0.0, |(patches, _)| self.plan.worth(patches.end))
        } else {
            0.0
        };
        let carried = value.max_element() * self.plan.worth(column).max(shining * of_map);
        if carried >= 1.0 {
            return Some(value);
        }
        let die = (joint.roulette.wrapping_add(nth.wrapping_mul(GOLDEN)) >> 8) as f32 / 16_777_216.0;
        (die < carried).then(|| value / carried)
    }

    /// Connects a vertex to a point of one light.
    fn connect_one(
        &self,
        joint: &Joint<'_>,
        (nth, pick): (u32, Pick),
        fan: &mut Fan,
        later: &mut [u64; 2],
        deposit: &mut impl Deposit,
    ) {
        let Joint { walk, vertex, hit, outward, jitter, .. } = *joint;
        let u = jittered(jitter, nth);
        let light = self.light_point(pick.column, hit.position, u);
        if !self.scene.slabs.is_empty() {
            self.connect_behind_slabs(joint, (nth, pick), light.as_ref(), deposit);
        }
        let Some(light) = light else { return };
        let mut value = joint.arriving(&light, pick);
        if value.max_element() <= 0.0 {
            return;
        }
        // Walks to the same lights are attenuated as well, but for those that never end.
        if self.scene.attenuates && !light.beyond {
            let extinction = self.extinction_towards(walk, hit, light.wi);
            value *= (-extinction * light.target.distance(hit.position)).exp();
        }
        later[0] += u64::from(vertex != Vertex::First);
        let Some(value) = self.worth_it(joint, value, nth, pick.column, light.shining) else {
            later[1] += 1;
            return;
        };
        if light.wi.dot(outward) > 0.0 {
            fan.push(self, light.target, pick.column, value, deposit);
        } else {
            let behind = hit.origin(-outward);
            self.give(pick.column, light.wi, value * self.scene.transmittance(behind, light.target), deposit);
        }
    }

    /// Connects a vertex to a point of one light through the slabs on the way, if there are any; `straight` is what there is of
    /// the light without them.
    fn connect_behind_slabs(
        &self,
        joint: &Joint<'_>,
        (nth, pick): (u32, Pick),
        straight: Option<&LightPoint>,
        deposit: &mut impl Deposit,
    ) {
        let Joint { walk, hit, jitter, .. } = *joint;
        let at = (pick.column, hit.position, jittered(jitter, nth));
        if let Some((light, route)) = self.light_behind_slabs(walk, at, straight)
            && let Some(value) = self.worth_it(joint, joint.arriving(&light, pick), nth, pick.column, light.shining)
            && value.max_element() > 0.0
        {
            let passed = self.passed_along(walk, hit, &light, &route);
            self.give(pick.column, light.wi, value * passed, deposit);
        }
    }

    /// A point on the light of a column, as seen from `position`; `None` where it sends nothing this way.
    fn light_point(&self, column: u32, position: Vec3, u: Vec2) -> Option<LightPoint> {
        let place = self.columns[column as usize];
        match &self.scene.lighting.emitters[place.source as usize] {
            Emitter::Panel(panel) => {
                let uv = place.texel(u) * panel.texel_side;
                let target = panel.point(uv);
                let radiance = if panel.textured {
                    let uvs = panel.uv_frame.map(|[o, du, dv]| o + du * uv.x + dv * uv.y);
                    self.scene.pattern(self.scene.material(panel.triangle), uvs)
                } else {
                    Vec3::ONE
                };
                area_point(position, target, panel.normal, panel.double_sided, panel.texel_area, radiance)
            }
            Emitter::Surface(surface) => {
                let SurfacePoint { position: target, normal, double_sided, white, varies, triangle, barycentric } =
                    surface.sample(u);
                // Walks meet it with its alpha as probability.
                let radiance = if varies { white * self.scene.shown(triangle, barycentric) } else { white };
                area_point(position, target, normal, double_sided, surface.area, radiance)
            }
            Emitter::Punctual(light) if light.kind == PunctualKind::Directional => {
                let wi = -light.direction;
                Some(LightPoint {
                    target: position + wi * self.far,
                    wi,
                    factor: Vec3::ONE,
                    spread_sr: 0.0,
                    beyond: true,
                    shining: 0.0,
                })
            }
            Emitter::Punctual(light) => {
                let to_light = light.position - position;
                let distance_squared = to_light.length_squared();
                let wi = to_light / distance_squared.sqrt();
                let falloff = punctual_falloff(light, &self.scene.scene.profiles, -wi);
                let factor = Vec3::splat(falloff / distance_squared);
                (falloff > 0.0 && distance_squared > 0.0).then_some(LightPoint {
                    target: light.position,
                    wi,
                    factor,
                    spread_sr: 0.0,
                    beyond: false,
                    shining: 0.0,
                })
            }
            Emitter::Lamp(lamp) => lamp.lit(position, u, self.far).map(|lit| LightPoint {
                target: lit.target,
                wi: lit.wi,
                factor: Vec3::splat(lit.factor),
                spread_sr: lit.spread_sr,
                beyond: lamp.is_beyond(),
                shining: 0.0,
            }),
            sky => {
                let first = self.scene.lighting.basis.sources[place.source as usize].columns.start;
                self.sky_point(sky, column - first, position, u)
            }
        }
    }
}

/// A vertex that is being connected to lights.
struct Joint<'a> {
    walk: &'a Walk,
    vertex: Vertex,
    rivals: Rivals,
    hit: &'a SurfaceHit,
    bsdf: &'a Bsdf,
    /// Unit geometric normal on the side that the walk came from.
    outward: Vec3,
    /// Random offset of the lattice of points on lights.
    jitter: [u32; 2],
    /// The same of the numbers that roulette draws.
    roulette: u32,
}

impl Joint<'_> {
    /// What a connection to a point of a light brings if nothing is in the way, per unit of the light's column.
    #[inline]
    fn arriving(&self, light: &LightPoint, pick: Pick) -> Vec3 {
        let f_cos = self.rivals.weigh(self.bsdf, light.wi, light.spread_sr * pick.inverse_rate);
        self.walk.carried() * f_cos * light.factor * pick.inverse_rate
    }

    /// The surface that looks at many lights at once; `None` for one that lets light pass or has a finish.
    fn onlooker(&self) -> Option<Onlooker> {
        let surface = self.bsdf.lanes()?;
        let (position, carried) = (self.hit.position, self.walk.carried());
        Some(Onlooker { position, surface, rivals: self.rivals, carried, jitter: self.jitter })
    }
}

/// Continuations from a vertex that may meet the very lights it connects to.
#[derive(Clone, Copy)]
enum Rivals {
    /// Walks by all lobes.
    All { splits: u32 },
    /// One walk by one of the lobes, whose light by the diffuse base and by the others is told apart.
    Parts,
    /// One walk by all lobes but the diffuse base, and the light that the diffuse base receives is known.
    CoatAlone,
}

impl Rivals {
    /// `f·|cosθ|` times the share that falls to a connection, given one over its density (0 for a lamp without size).
    #[inline]
    fn weigh(self, bsdf: &Bsdf, wi: Vec3, spread_sr: f32) -> Vec3 {
        let share = |rival: f32| share_against(rival * spread_sr);
        match self {
            Rivals::All { splits } => {
                let (f_cos, pdf) = bsdf.eval(wi);
                f_cos * share(pdf * splits as f32)
            }
            Rivals::Parts => {
                let parts = bsdf.eval_parts(wi);
                parts.base * share(parts.base_pdf) + parts.coat * share(parts.coat_pdf)
            }
            Rivals::CoatAlone => {
                let parts = bsdf.eval_parts(wi);
                parts.coat * share(parts.coat_pdf)
            }
        }
    }
}

impl Walk {
    fn from_camera(origin: Vec3, direction: Vec3) -> Walk {
        Walk {
            origin,
            direction,
            throughput: Vec3::ONE,
            share: 1.0,
            density: 0.0,
            passed: 0.0,
            departed: origin,
            passage: Passage::default(),
            sharpness: f32::INFINITY,
            sampled_at: None,
            rival: None,
            straight: true,
            specular: true,
            n_hits: 0,
            n_before: 0,
            extinction: Vec3::ZERO,
            guides: Guides::None,
            caustic_share: 1.0,
        }
    }

    /// What multiplies the light that the walk meets.
    #[inline]
    fn carried(&self) -> Vec3 {
        self.throughput * self.caustic_share
    }

    fn ray(&self) -> Ray {
        Ray { origin: self.origin, direction: self.direction, t_min: 0.0, t_max: f32::INFINITY }
    }
}

/// Up to 16 connections from one point whose visibility is asked together.
struct Fan {
    origin: Vec3,
    n: usize,
    targets: [Vec3; 16],
    columns: [u32; 16],
    values: [Vec3; 16],
}

impl Fan {
    fn new(origin: Vec3) -> Fan {
        Fan { origin, n: 0, targets: [Vec3::ZERO; 16], columns: [0; 16], values: [Vec3::ZERO; 16] }
    }

    fn push<P: LightPlan>(
        &mut self,
        walks: &Integrator<'_, P>,
        target: Vec3,
        column: u32,
        value: Vec3,
        deposit: &mut impl Deposit,
    ) {
        (self.targets[self.n], self.columns[self.n], self.values[self.n]) = (target, column, value);
        self.n += 1;
        if self.n == 16 {
            self.flush(walks, deposit);
        }
    }

    fn flush<P: LightPlan>(&mut self, walks: &Integrator<'_, P>, deposit: &mut impl Deposit) {
        let mut passed = [Vec3::ZERO; 16];
        if self.n > 0 {
            walks.scene.transmittance16(self.origin, &self.targets, self.n, &mut passed);
        }
        for i in (0..self.n).filter(|&i| passed[i] != Vec3::ZERO) {
            let toward = self.targets[i] - self.origin;
            walks.give(self.columns[i], toward, self.values[i] * passed[i], deposit);
        }
        self.n = 0;
    }
}

fn area_point(
    position: Vec3,
    target: Vec3,
    normal: Vec3,
    double_sided: bool,
    area: f32,
    radiance: Vec3,
) -> Option<LightPoint> {
    let to_light = target - position;
    let closeness = 1.0 / to_light.length_squared();
    let wi = to_light * closeness.sqrt();
    let cos = -wi.dot(normal);
    let cos = if double_sided { cos.abs() } else { cos };
    let spread_sr = cos * area * closeness;
    (cos > 0.0 && closeness.is_finite()).then_some(LightPoint {
        target,
        wi,
        factor: radiance * spread_sr,
        spread_sr,
        beyond: false,
        shining: 0.0,
    })
}

/// A direction to go on, unless the walk is absorbed. A surface of one lobe has nothing to choose from.
fn sampled(bsdf: &Bsdf, sampler: &mut Sampler) -> Option<BsdfSample> {
    let u_lobe = if bsdf.is_diffuse() { 0.0 } else { sampler.next_1d() };
    bsdf.sample(u_lobe, sampler.next_2d())
}

/// Share of one of two ways to sample the same path, by squared densities. \[Veach1995\]
fn power_heuristic(own: f32, other: f32) -> f32 {
    share_against(other / own)
}

/// The same, given the density of the other over the own one.
#[inline]
fn share_against(ratio: f32) -> f32 {
    1.0 / (1.0 + ratio * ratio)
}

/// A number in 0…1 as 32 bits.
fn bits_of(u: f32) -> u32 {
    (f64::from(u) * 4_294_967_296.0) as u32
}

/// Steps of the golden ratio: numbers that neighbors draw are far apart.
const GOLDEN: u32 = 0x9E37_79B9;

/// Steps of a lattice in the plane whose points are far apart. \[Roberts2018\]
const STEP: [u32; 2] = [0xC13F_A9A9, 0x91E1_0DA5];

/// The `nth` point of the lattice, shifted by a random offset: every point is uniform, neighbors differ.
fn jittered(offset: [u32; 2], nth: u32) -> Vec2 {
    let unit = |offset: u32, step: u32| (offset.wrapping_add(nth.wrapping_mul(step)) >> 8) as f32 / 16_777_216.0;
    Vec2::new(unit(offset[0], STEP[0]), unit(offset[1], STEP[1]))
}
