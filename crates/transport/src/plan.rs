//! Which lights a vertex connects to: all of them for a matrix, the important ones for a picture.

use std::ops::Range;

use glam::{Vec2, Vec3};

use crate::basis::{ColumnGroup, ColumnKind, SourceKind};
use crate::emitters::{Emitter, Lighting, PanelEmitter};
use crate::lamps::Body;
use crate::light::luminance;
use crate::matrix::median;
use crate::path::{LightPlan, Pick, Vertex};
use crate::sampler::Sampler;
use crate::scene::PunctualKind;
use crate::skips::{Skip, Skips};
use crate::sky::{SkyPicks, Unseen};

/// For a matrix: every column at the first vertex, at later ones a few of each group, stratified, so that each column of
/// a group gets its equal share.
pub struct MatrixPlan {
    /// Columns that later vertices connect to, group by group, with the number of picks.
    later: Vec<(Vec<u32>, u32)>,
    /// Columns of the first vertex; lamps along a curve through space and texels of a panel tile by tile, so that sixteen
    /// neighbors look the same way.
    first: Vec<u32>,
    /// All of `first`, once each.
    all: Vec<Pick>,
    /// Neighbors in `first` of which one is picked, the others left out.
    stride: usize,
    /// Expected picks of each column at the first vertex.
    first_rate: Vec<f32>,
    splits: u32,
    /// See [`LightPlan::worth`].
    worth: Vec<f32>,
    /// See [`LightPlan::peaks`].
    peaks: Option<f32>,
    /// Panels of which later vertices see a few texels only.
    thinned: Vec<ThinnedPanel>,
    /// Patches of the sky.
    sky: SkyPicks,
}

/// A panel of which one texel in `stretch` is connected to.
struct ThinnedPanel {
    panel: PanelEmitter,
    stretch: f32,
    /// Greatest [`LightPlan::worth`] of its texels.
    worth: f32,
    columns: Range<u32>,
}

/// How many of the columns the first vertex connects to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Density {
    /// All of them.
    Full,
    /// One of four neighboring texels of a panel, for a preview.
    Quarter,
}

/// Columns of a panel that a later vertex connects to.
const LATER_TEXELS: u32 = 8;
/// Columns of lamps that a later vertex connects to: unlike texels each has a place of its own, and roulette takes the weak.
const LATER_LAMPS: u32 = 32;
/// Radiance, in peaks of its column, below which a connection is left to roulette.
const ROULETTE_BELOW: f32 = 0.5;
/// Radiance, in the unit of [`LightPlan::worth`], that a single pick of few may carry; where it would be more, all are taken.
const MOST_PER_PICK: f32 = 50.0;

impl MatrixPlan {
    /// For all columns that can be connected to.
    pub fn new(lighting: &Lighting, density: Density) -> MatrixPlan {
        MatrixPlan::without(lighting, density, &[])
    }

    /// The same without some sources, given in order, that light nothing.
    pub fn without(lighting: &Lighting, density: Density, dark: &[u32]) -> MatrixPlan {
        let basis = &lighting.basis;
        let shines = |source: usize| dark.binary_search(&(source as u32)).is_err();
        let later = later_picks(lighting, shines);
        let mut first: Vec<u32> = along_a_curve(lighting)
            .into_iter()
            .map(|idx| &basis.sources[idx])
            .filter(|s| later.iter().any(|(columns, _)| columns.binary_search(&s.columns.start).is_ok()))
            .flat_map(|source| in_tiles(source.kind, source.columns.clone()))
            .collect();
        let is_dome = |emitter: &Emitter| matches!(emitter, Emitter::Dome(_));
        let dome = lighting.emitters.iter().position(is_dome).filter(|&source| shines(source));
        let sky = dome.map_or_else(SkyPicks::default, |_| SkyPicks::new(lighting));
        first.extend(sky.columns());
        // Lamps are few and unlike each other; neighboring texels are many and alike.
        let stride = if density == Density::Quarter && first.len() >= 128 { 4 } else { 1 };
        // A fan over many columns is dear, so its vertex is used for several continuations.
        let splits = match first.len() {
            0..=8 => 1,
            9..=32 => 2,
            _ => 4,
        };
        let (worth, first_rate) = (vec![f32::INFINITY; basis.n_cols()], vec![0.0; basis.n_cols()]);
        let (all, thinned, peaks) = (Vec::new(), Vec::new(), None);
        let mut plan = MatrixPlan { later, first, all, stride, first_rate, splits, worth, peaks, thinned, sky };
        plan.count_picks();
        // A preview has no time to look at all texels again.
        if density == Density::Full {
            plan.thinned = plan.thinned_panels(lighting);
        }
        plan
    }

    /// For walks that mostly end where the light is known: what they find themselves takes few picks.
    pub fn for_short_walks(mut self) -> MatrixPlan {
        self.later.iter_mut().for_each(|(_, n_picks)| *n_picks = (*n_picks).min(LATER_TEXELS));
        self
    }

    /// One light at a first vertex, and one of each group at later ones: there to be compared with.
    pub fn with_lone_picks(mut self) -> MatrixPlan {
        self.later.iter_mut().for_each(|(_, n_picks)| *n_picks = 1);
        self.stride = self.first.len().max(1);
        self.thinned.clear();
        self.count_picks();
        self
    }

    /// Fitted to what pilots measured: what each column is multiplied by, and the mean of each patch of the sky.
    pub fn fitted(self, column_scale: &[f32], sky_reach: &[f32], skips: Skips) -> MatrixPlan {
        let unseen = if skips.has(Skip::UnseenPatches) { Unseen::Dropped } else { Unseen::Kept };
        let mut plan = self.with_roulette(column_scale).with_sky_reach(sky_reach, unseen);
        if !skips.has(Skip::WeakLight) {
            plan.worth.fill(f32::INFINITY);
        }
        plan
    }

    /// Leaves connections that carry little to roulette, given what each column is multiplied by.
    pub fn with_roulette(self, column_scale: &[f32]) -> MatrixPlan {
        let worth = column_scale.iter().map(|scale| scale / ROULETTE_BELOW).collect();
        // Behind the columns of lights there may be those of patches, which guide no walk of these.
        let of_lights = column_scale.iter().take(self.worth.len());
        let peaks = median(of_lights.copied().filter(|scale| scale.is_finite()));
        let mut plan = MatrixPlan { worth, peaks, ..self };
        for panel in &mut plan.thinned {
            let worth = &plan.worth[panel.columns.start as usize..panel.columns.end as usize];
            panel.worth = worth.iter().copied().fold(0.0, f32::max);
        }
        plan
    }

    fn thinned_panels(&self, lighting: &Lighting) -> Vec<ThinnedPanel> {
        let thin = |(source, panel): (usize, &PanelEmitter)| {
            let columns = lighting.basis.sources[source].columns.clone();
            let rate = self.rate(Vertex::Later, columns.start);
            let (stretch, worth) = (1.0 / rate, f32::INFINITY);
            (0.0 < rate && rate < 1.0).then(|| ThinnedPanel { panel: panel.clone(), stretch, worth, columns })
        };
        lighting.panels().filter_map(thin).collect()
    }

    /// Connects to patches of the sky as pilots saw them, see [`SkyPicks::learn`].
    pub fn with_sky_reach(mut self, reach: &[f32], unseen: Unseen) -> MatrixPlan {
        let before = self.sky.columns().to_vec();
        self.sky.learn(reach, unseen);
        let sky = &self.sky;
        self.first.retain(|column| before.binary_search(column).is_err() || sky.later_rate(*column).is_some());
        self.count_picks();
        self
    }

    fn count_picks(&mut self) {
        self.all = self.first.iter().map(|&column| Pick { column, inverse_rate: 1.0 }).collect();
        self.first_rate.fill(0.0);
        for chunk in self.first.chunks(self.stride) {
            for &column in chunk {
                self.first_rate[column as usize] = 1.0 / chunk.len() as f32;
            }
        }
    }
}

/// The columns of each group that later vertices connect to, in order, with the number of picks.
fn later_picks(lighting: &Lighting, shines: impl Fn(usize) -> bool) -> Vec<(Vec<u32>, u32)> {
    let basis = &lighting.basis;
    let connected = basis.groups.iter().filter(|g| matches!(g.kind, ColumnKind::Luminaire | ColumnKind::Panel));
    let of_group = |group: &ColumnGroup| {
        let sources = basis.sources.iter().enumerate().filter(|(source, _)| shines(*source));
        let within = sources.filter(|(_, source)| group.columns.contains(&source.columns.start));
        let columns: Vec<u32> = within.flat_map(|(_, source)| source.columns.clone()).collect();
        let most = if group.kind == ColumnKind::Panel { LATER_TEXELS } else { LATER_LAMPS };
        let n_picks = most.min(columns.len() as u32);
        (columns, n_picks)
    };
    connected.map(of_group).filter(|(columns, _)| !columns.is_empty()).collect()
}

/// Place along Morton's curve through the plane or through space, of coordinates of at most 64 / N bits. \[Morton1966\]
pub(crate) fn along_morton<const N: usize>(at: [u32; N]) -> u64 {
    let n_bits = (u64::BITS as usize / N).min(u32::BITS as usize);
    let bit = |bit: usize| (0..N).map(move |axis| u64::from(at[axis] >> bit & 1) << (N * bit + axis)).sum::<u64>();
    (0..n_bits).map(bit).sum()
}

/// The sources in an order in which neighbors are near each other: lamps along Morton's curve, those without a place last.
fn along_a_curve(lighting: &Lighting) -> Vec<usize> {
    let place = |emitter: &Emitter| match emitter {
        Emitter::Punctual(light) if light.kind != PunctualKind::Directional => Some(light.position),
        Emitter::Surface(surface) => Some(surface.center()),
        Emitter::Panel(panel) => Some(panel.point(Vec2::splat(0.5))),
        Emitter::Lamp(lamp) => lamp.point(Vec2::splat(0.5)).map(|point| point.position),
        _ => None,
    };
    let places: Vec<Option<Vec3>> = lighting.emitters.iter().map(place).collect();
    let known = || places.iter().flatten().copied();
    let low = known().fold(Vec3::INFINITY, Vec3::min);
    let side = (known().fold(Vec3::NEG_INFINITY, Vec3::max) - low).max_element().max(f32::MIN_POSITIVE);
    let key = |at: Vec3| along_morton(((at - low) / side * 1023.0).to_array().map(|x| x.clamp(0.0, 1023.0) as u32));
    let mut order: Vec<usize> = (0..places.len()).collect();
    order.sort_by_key(|&idx| places[idx].map_or(u64::MAX, key));
    order
}

/// Side of the tiles in which a panel's texels are asked for.
const FAN_TILE: u32 = 4;

/// The columns of a source; those of a panel tile by tile.
fn in_tiles(kind: SourceKind, columns: Range<u32>) -> Vec<u32> {
    let mut order: Vec<u32> = columns.clone().collect();
    if let SourceKind::Panel { resolution, .. } = kind {
        order.sort_by_key(|column| {
            let (i, j) = ((column - columns.start) % resolution, (column - columns.start) / resolution);
            (j / FAN_TILE, i / FAN_TILE, j, i)
        });
    }
    order
}

impl ThinnedPanel {
    /// Whether one pick of few could bring more than [`MOST_PER_PICK`].
    fn is_close(&self, position: Vec3, peak: f32) -> bool {
        let panel = &self.panel;
        let toward = panel.uv_of(position).clamp(Vec2::ZERO, Vec2::ONE);
        let distance_squared = (position - panel.point(toward)).length_squared();
        let solid_angle = panel.texel_area / distance_squared.max(panel.texel_area);
        let faces = panel.double_sided || (position - panel.origin).dot(panel.normal) > 0.0;
        faces && self.worth.is_finite() && peak * solid_angle * self.stretch * self.worth > MOST_PER_PICK
    }
}

impl LightPlan for MatrixPlan {
    fn later(&self, position: Vec3, peak: impl FnOnce() -> f32) -> Vertex {
        if self.thinned.is_empty() {
            return Vertex::Later;
        }
        let peak = peak();
        let close = self.thinned.iter().any(|panel| panel.is_close(position, peak));
        if close { Vertex::Close } else { Vertex::Later }
    }

    fn all(&self, vertex: Vertex) -> Option<&[Pick]> {
        let connects_to_all = vertex == Vertex::Close || (vertex == Vertex::First && self.stride == 1);
        connects_to_all.then_some(&self.all)
    }

    fn pick(&self, vertex: Vertex, sampler: &mut Sampler, picks: &mut Vec<Pick>) {
        picks.clear();
        if self.all(vertex).is_some() {
            picks.extend_from_slice(&self.all);
            return;
        }
        if vertex == Vertex::First {
            for chunk in self.first.chunks(self.stride) {
                let nth = if chunk.len() == 1 { 0 } else { (sampler.next_1d() * chunk.len() as f32) as usize };
                picks.push(Pick { column: chunk[nth.min(chunk.len() - 1)], inverse_rate: chunk.len() as f32 });
            }
            return;
        }
        for (group, n_picks) in &self.later {
            let n = group.len() as u32;
            if n == *n_picks {
                picks.extend(group.iter().map(|&column| Pick { column, inverse_rate: 1.0 }));
                continue;
            }
            // One column from each of equal stretches of the group.
            let stretch = n as f32 / *n_picks as f32;
            for nth in 0..*n_picks {
                let at = (nth as f32 + sampler.next_1d()) * stretch;
                picks.push(Pick { column: group[(at as usize).min(group.len() - 1)], inverse_rate: stretch });
            }
        }
        self.sky.pick_later(sampler, picks);
    }

    fn rate(&self, vertex: Vertex, column: u32) -> f32 {
        match vertex {
            Vertex::First => self.first_rate[column as usize],
            Vertex::Close => f32::from(self.first_rate[column as usize] > 0.0),
            Vertex::Later => {
                if let Some(rate) = self.sky.later_rate(column) {
                    return rate;
                }
                let stratum = self.later.iter().find(|(group, _)| group.binary_search(&column).is_ok());
                stratum.map_or(0.0, |(group, n_picks)| *n_picks as f32 / group.len() as f32)
            }
        }
    }

    fn splits(&self) -> u32 {
        self.splits
    }

    fn worth(&self, column: u32) -> f32 {
        self.worth[column as usize]
    }

    fn peaks(&self) -> Option<f32> {
        self.peaks
    }
}

/// For a picture under given coefficients: most picks go to columns in proportion to the light they send out, the others to all
/// lights alike. Beside a sun over a wide land a lamp sends out next to nothing, and yet it may be all the light that a room has.
pub struct PicturePlan {
    /// Summed probabilities of the columns that shine. In single precision weak ones would round away beside strong ones.
    cumulative: Vec<(u32, f64)>,
    probability: Vec<f32>,
}

impl PicturePlan {
    /// Picks at the first vertex and at later ones.
    const PICKS: [u32; 2] = [4, 1];
    /// Share of the picks that goes to all lights alike.
    const ALIKE: f64 = 0.25;

    /// For one RGB coefficient per column.
    pub fn new(lighting: &Lighting, coefficients: &[[f32; 3]], diameter_m: f32) -> PicturePlan {
        let mut powers = vec![0.0; coefficients.len()];
        for (source, emitter) in lighting.basis.sources.iter().zip(&lighting.emitters) {
            let power = match (emitter, source.kind) {
                (Emitter::Surface(surface), _) => surface.area,
                (Emitter::Panel(panel), _) => panel.texel_area,
                (_, SourceKind::Directional) => diameter_m * diameter_m / 4.0,
                (Emitter::Punctual(_), _) => 1.0,
                (Emitter::Lamp(lamp), _) => lamp.body().map_or(1.0, Body::area),
                (Emitter::Environment(map), _) => {
                    map.mean_luminance() * std::f32::consts::PI * diameter_m * diameter_m / 4.0
                }
                (Emitter::Sun(_), _) => diameter_m * diameter_m / 4.0,
                (Emitter::Dome(_) | Emitter::Sky | Emitter::Constant, _) => 0.0,
            };
            for column in source.columns.clone() {
                let color = Vec3::from(coefficients[column as usize]);
                let brightness = luminance(color) + 1e-3 * color.max_element();
                powers[column as usize] = f64::from(power) * f64::from(brightness.max(0.0));
            }
        }
        let total: f64 = powers.iter().sum();
        let n_shining = |columns: &Range<u32>| columns.clone().filter(|&column| powers[column as usize] > 0.0).count();
        let sources = lighting.basis.sources.iter().map(|source| (&source.columns, n_shining(&source.columns)));
        let shining: Vec<(&Range<u32>, usize)> = sources.filter(|(_, n)| *n > 0).collect();
        let (mut probability, mut cumulative, mut sum) = (vec![0.0; coefficients.len()], Vec::new(), 0.0);
        for &(columns, n) in &shining {
            let alike = PicturePlan::ALIKE / (shining.len() * n) as f64;
            for column in columns.clone().filter(|&column| powers[column as usize] > 0.0) {
                let own = (1.0 - PicturePlan::ALIKE) * powers[column as usize] / total + alike;
                sum += own;
                probability[column as usize] = own as f32;
                cumulative.push((column, sum));
            }
        }
        PicturePlan { cumulative, probability }
    }

    fn picks_at(vertex: Vertex) -> u32 {
        PicturePlan::PICKS[usize::from(vertex != Vertex::First)]
    }
}

/// A number in one of `n` equal stretches of [0, 1). In single precision the later stretches would lose the last digits of `u`, and end at 1.
fn within_stretch(nth: u32, n: u32, u: f32) -> f64 {
    (f64::from(nth) + f64::from(u)) / f64::from(n)
}

impl LightPlan for PicturePlan {
    fn later(&self, _: Vec3, _: impl FnOnce() -> f32) -> Vertex {
        Vertex::Later
    }

    fn pick(&self, vertex: Vertex, sampler: &mut Sampler, picks: &mut Vec<Pick>) {
        picks.clear();
        let Some(&(_, total)) = self.cumulative.last() else { return };
        let n = PicturePlan::picks_at(vertex);
        for nth in 0..n {
            let at = within_stretch(nth, n, sampler.next_1d()) * total;
            let chosen = self.cumulative.partition_point(|&(_, sum)| sum <= at).min(self.cumulative.len() - 1);
            let column = self.cumulative[chosen].0;
            picks.push(Pick { column, inverse_rate: 1.0 / (n as f32 * self.probability[column as usize]) });
        }
    }

    fn rate(&self, vertex: Vertex, column: u32) -> f32 {
        PicturePlan::picks_at(vertex) as f32 * self.probability[column as usize]
    }

    fn splits(&self) -> u32 {
        1
    }

    fn worth(&self, _: u32) -> f32 {
        f32::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::laws::stage::{Stage, lambert, quad};
    use crate::light::LightRig;

    #[test]
    fn a_weak_lamp_beside_a_sun_is_picked_as_often_as_is_told() {
        let camera = Camera::look_at("eye", Vec3::Y, Vec3::ZERO, 1.0, 1.0);
        let land = quad(Vec3::new(-1000.0, 0.0, 1000.0), Vec3::X * 2000.0, Vec3::NEG_Z * 2000.0);
        let stage = Stage::new(camera).surface("land", &land, lambert(0.5, 0.0));
        let scene = stage.distant("sun", Vec3::NEG_Y, 1e5).lamp("lamp", Vec3::Y, 0.1).prepared();
        let plan =
            PicturePlan::new(&scene.lighting, &scene.lighting.basis.project(&LightRig::default()), scene.diameter());
        let (mut picks, n) = (Vec::new(), 4096);
        for vertex in [Vertex::First, Vertex::Later] {
            let mut counts = [0u32; 2];
            for nth in 0..n {
                plan.pick(vertex, &mut Sampler::new(3, 0, nth), &mut picks);
                for pick in &picks {
                    let told = 1.0 / plan.rate(vertex, pick.column);
                    assert!((pick.inverse_rate / told - 1.0).abs() < 1e-5, "{vertex:?}: {pick:?}, told {told}");
                    counts[pick.column as usize] += 1;
                }
            }
            for (column, count) in (0..).zip(counts) {
                let (found, told) = (count as f32 / n as f32, plan.rate(vertex, column));
                assert!(told > 0.1, "{vertex:?}, column {column}: {told} picks");
                assert!((found / told - 1.0).abs() < 0.1, "{vertex:?}, column {column}: {found} picks, told {told}");
            }
        }
    }

    #[test]
    fn every_stretch_tells_all_random_numbers_apart() {
        for nth in 0..4 {
            let [below, last] = [2.0, 1.0].map(|ulps| within_stretch(nth, 4, 1.0 - ulps * 0.5 * f32::EPSILON));
            assert!(below < last && last < f64::from(nth + 1) / 4.0, "stretch {nth}: {below}, {last}");
        }
    }

    #[test]
    fn lights_that_are_off_are_never_picked() {
        let camera = Camera::look_at("eye", Vec3::Y, Vec3::ZERO, 1.0, 1.0);
        let floor = quad(Vec3::new(-1.0, 0.0, 1.0), Vec3::X * 2.0, Vec3::NEG_Z * 2.0);
        let stage = Stage::new(camera).surface("floor", &floor, lambert(0.5, 0.0));
        let scene = stage.lamp("on", Vec3::Y, 1.0).lamp("off", Vec3::Y, 1.0).prepared();
        let plan = PicturePlan::new(&scene.lighting, &[[1.0; 3], [0.0; 3]], 1.0);
        assert_eq!([0, 1].map(|column| plan.rate(Vertex::Later, column)), [1.0, 0.0]);
        let dark = PicturePlan::new(&scene.lighting, &[[0.0; 3]; 2], 1.0);
        let mut picks = Vec::new();
        dark.pick(Vertex::First, &mut Sampler::new(3, 0, 0), &mut picks);
        assert!(picks.is_empty(), "{picks:?}");
    }
}
