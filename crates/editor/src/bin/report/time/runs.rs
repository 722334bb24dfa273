//! Each way measured with growing numbers of samples, in turn.

use std::sync::Arc;

use anyhow::Result;
use clerestory_nystrom::BlockLowRank;
use clerestory_transport::bake::{BakeConfig, BakeHeader, BakeJob, Indirect, Passes};
use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::light::{LightRig, PanelSpot};
use clerestory_transport::matrix::CHANNELS;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;

use super::{Point, Subject, TARGETS_DB, Way, prepared};
use crate::desk::Desk;
use crate::matrix::{baked, process_cpu_secs};
use crate::reference::{Reference, Sampling, uncompressed};
use crate::rendered::rendered;
use crate::under_way::{ends_a_pass, run_until};

/// Samples per pixel that are tried, as far as they do not take too long.
const SPP: [u32; 6] = [1, 4, 16, 64, 256, 1024];
/// Most samples of pixels of one bake, of all renders of one point, and of one render: in a hurry, and else.
const MOST_BAKED: [f64; 2] = [5e4, 3.2e6];
const MOST_TRACED: [f64; 2] = [4e5, 4e7];
const MOST_PLAIN: [f64; 2] = [4e5, 5.2e7];
/// The same for the way of ours that is ahead, where it has not come to the greatest dB yet.
const MOST_FURTHER: [f64; 2] = [0.0, 1.3e7];
/// Most samples per pixel of a render of a spot.
const MOST_SPOT_SPP: u32 = 256;
/// Ways of ours, and how each one takes indirect light.
const OURS: [(Way, Indirect); 2] = [(Way::Fast, Indirect::Shared), (Way::Exact, Indirect::Traced)];
/// Middles of the spots on a panel, and their radius in its shorter sides.
const SPOTS: [[f32; 2]; 3] = [[0.5, 0.5], [0.2, 0.7], [0.85, 0.25]];
const SPOT_RADIUS: f32 = 0.15;
/// The first for all, and more where few samples are taken, to tell how far repeats lie apart.
pub(super) const SEEDS: [u64; 3] = [1, 2, 3];
pub(super) const REPEATED_SPP: u32 = 4;

/// Samples per pixel of each half of a reference.
pub(super) fn reference_spp(desk: &Desk) -> u32 {
    desk.choose(16, 64)
}

/// What the answers are held against, and under which lights.
pub(super) struct Judge {
    reference: Reference,
    /// A coefficient per column: spots if there is a panel, then all lights as in the file.
    spots: Vec<Vec<[f32; 3]>>,
    full: Vec<[f32; 3]>,
}

impl Judge {
    pub(super) fn new(desk: &Desk, subject: &Subject, scene: &Arc<PreparedScene>) -> Result<Judge> {
        let sampling = Sampling { film: subject.film, step: subject.step, bounces: None, spp: reference_spp(desk) };
        let reference = Reference::new(desk, &subject.files(), scene, sampling)?;
        let basis = &scene.lighting.basis;
        Ok(Judge { reference, spots: spots(basis), full: basis.project(&LightRig::default()) })
    }

    /// Errors of rows that are laid out as the reference's.
    fn of_rows(&self, rows: &[f32]) -> [Option<f64>; 3] {
        let picture = |light: &Vec<[f32; 3]>| self.reference.picture_db(light, &self.reference.relit(rows, light));
        let spots: Option<Vec<f64>> = self.spots.iter().map(picture).collect();
        [self.reference.errors(rows).median_db(), spots.and_then(mean), picture(&self.full)]
    }

    /// What the mean of both references would be told to have, by its standard error alone: nothing nearer can be told apart.
    fn ends(&self) -> [Option<f64>; 3] {
        self.of_rows(&self.reference.mean())
    }

    pub(super) fn of_bake(&self, header: &BakeHeader, groups: &[BlockLowRank]) -> [Option<f64>; 3] {
        self.of_rows(&self.reference.rows_of(header, groups))
    }

    fn of_picture(&self, light: &[[f32; 3]], picture: &[[f32; 3]]) -> Option<f64> {
        let pixels = self.reference.pixels().iter().flat_map(|&pixel| picture[pixel as usize]);
        self.reference.picture_db(light, &pixels.collect::<Vec<_>>())
    }
}

/// None of nothing.
fn mean(values: Vec<f64>) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Coefficients under a spot on the first panel, all other lights dark; none without a panel.
fn spots(basis: &LightBasis) -> Vec<Vec<[f32; 3]>> {
    let is_panel = |kind: SourceKind| matches!(kind, SourceKind::Panel { .. });
    let Some(panel) = basis.sources.iter().find(|source| is_panel(source.kind)) else { return Vec::new() };
    let light = |position: [f32; 2]| {
        let spot = PanelSpot { position, radius: SPOT_RADIUS, color: None, intensity: 1.0 };
        let panels = [(panel.key.clone(), vec![spot])].into_iter().collect();
        let mut light = basis.project(&LightRig { panels, ..LightRig::default() });
        let others = |column: &usize| !panel.columns.contains(&(*column as u32));
        (0..light.len()).filter(others).for_each(|column| light[column] = [0.0; 3]);
        light
    };
    SPOTS.into_iter().map(light).collect()
}

/// All points of a scene; those of one number of samples one after the other, so that other work on the machine meets all ways. And the
/// dB at which its reference ends.
pub(super) fn measure(
    desk: &Desk,
    subject: &Subject,
    scene: &Arc<PreparedScene>,
) -> Result<(Vec<Point>, [Option<f64>; 3])> {
    let judge = Judge::new(desk, subject, scene)?;
    desk.say(&format!("previewing {}", subject.name));
    let mut points = preview(subject, scene, &judge)?;
    let n_pixels = subject.film.n_pixels() as f64;
    let (baked, traced) = (desk.choose(MOST_BAKED[0], MOST_BAKED[1]), desk.choose(MOST_TRACED[0], MOST_TRACED[1]));
    for spp in SPP {
        let samples = n_pixels * f64::from(spp);
        desk.say(&format!("{} with {spp} samples per pixel, every way", subject.name));
        let n_seeds = if spp == REPEATED_SPP { SEEDS.len() } else { 1 };
        for taken in SEEDS[..n_seeds].iter().map(|&seed| Taken { spp, seed }) {
            if spp > 1 && samples <= baked {
                for way in OURS {
                    points.push(ours(subject, scene, &judge, way, taken)?);
                }
                points.push(dense(subject, scene, &judge, taken)?);
            }
            // Every light by itself takes longest of all, and lies nearest together.
            if taken.seed == SEEDS[0] && samples * scene.lighting.basis.n_cols() as f64 <= traced {
                points.push(renders(subject, scene, &judge, taken)?);
            }
            if samples <= desk.choose(MOST_PLAIN[0], MOST_PLAIN[1]) {
                points.extend(plain(subject, scene, &judge, taken)?);
            }
        }
    }
    Ok((points, judge.ends()))
}

/// More points of the way of ours that is ahead, on from the last of each (CPU seconds, dB of single lights) until the greatest error
/// that is asked about.
pub(super) fn further(desk: &Desk, subject: &Subject, curves: [&[[f64; 2]]; 2]) -> Result<Vec<Point>> {
    let (n_pixels, most) = (subject.film.n_pixels() as f64, desk.choose(MOST_FURTHER[0], MOST_FURTHER[1]));
    let new = |spp: &u32| desk.choose(MOST_BAKED[0], MOST_BAKED[1]) < n_pixels * f64::from(*spp);
    let [shared, traced] = curves.map(|curve| curve.last().map(|[_, db]| *db));
    let (ahead, mut reached) = if traced > shared { (OURS[1], traced) } else { (OURS[0], shared) };
    let (mut points, mut at_hand) = (Vec::new(), None);
    for spp in SPP.into_iter().filter(new).take_while(|spp| n_pixels * f64::from(*spp) <= most) {
        if reached.is_none_or(|db| TARGETS_DB.iter().all(|target| *target <= db)) {
            break;
        }
        let (scene, judge) = match at_hand.take() {
            Some(ready) => ready,
            None => {
                let scene = prepared(subject)?;
                let judge = Judge::new(desk, subject, &scene)?;
                (scene, judge)
            }
        };
        desk.say(&format!("{} with {spp} samples per pixel, {}", subject.name, ahead.0.name()));
        let taken = Taken { spp, seed: SEEDS[0] };
        let point = ours(subject, &scene, &judge, ahead, taken)?;
        reached = point.db[0];
        points.push(point);
        at_hand = Some((scene, judge));
    }
    Ok(points)
}

/// The samples of a point.
#[derive(Clone, Copy)]
struct Taken {
    spp: u32,
    seed: u64,
}

impl Taken {
    fn point(self, way: Way, cpu_secs: f64, db: [Option<f64>; 3]) -> Point {
        Point { way, seed: self.seed, spp: Some(self.spp), cpu_secs, db }
    }
}

/// The preview, which is the same whatever follows.
fn preview(subject: &Subject, scene: &Arc<PreparedScene>, judge: &Judge) -> Result<Vec<Point>> {
    let begun = process_cpu_secs()?;
    let preview = run_until(job(subject, scene, BakeConfig::default()), ends_a_pass)?;
    let cpu_secs = process_cpu_secs()? - begun;
    let db = judge.of_bake(&preview.header, &preview.groups);
    Ok([Way::Fast, Way::Exact].map(|way| Point { way, seed: SEEDS[0], spp: None, cpu_secs, db }).into())
}

pub(super) fn job(subject: &Subject, scene: &Arc<PreparedScene>, config: BakeConfig) -> BakeJob {
    let (camera, film) = (scene.scene.cameras[0].clone(), subject.film);
    let passes = Passes::PreviewAndFinal;
    BakeJob { scene: scene.clone(), camera, film, config, passes, irradiance: Vec::new() }
}

fn ours(
    subject: &Subject,
    scene: &Arc<PreparedScene>,
    judge: &Judge,
    (way, indirect): (Way, Indirect),
    taken: Taken,
) -> Result<Point> {
    // A tolerance out of reach: every block takes all its samples.
    let Taken { spp, seed } = taken;
    // Where light is traced, no pixel tells another.
    let denoise = indirect == Indirect::Shared;
    let config = BakeConfig { spp, tolerance_db: 80.0, seed, indirect, denoise, ..BakeConfig::default() };
    let (cpu_secs, bake) = baked(scene, subject.film, config)?;
    Ok(taken.point(way, cpu_secs, judge.of_bake(&bake.header, &bake.groups)))
}

/// The samples of a bake whose light is traced, kept as they are.
fn dense(subject: &Subject, scene: &Arc<PreparedScene>, judge: &Judge, taken: Taken) -> Result<Point> {
    let Taken { spp, seed } = taken;
    let job = job(subject, scene, BakeConfig { spp, seed, ..BakeConfig::default() });
    let begun = process_cpu_secs()?;
    let header = job.header()?;
    let rows = uncompressed(&job, &header, judge.reference.pixels());
    let cpu_secs = process_cpu_secs()? - begun;
    Ok(taken.point(Way::Dense, cpu_secs, judge.of_rows(&rows)))
}

/// A picture of each column by itself.
fn renders(subject: &Subject, scene: &Arc<PreparedScene>, judge: &Judge, taken: Taken) -> Result<Point> {
    let n_cols = scene.lighting.basis.n_cols();
    let mut rows = vec![0.0; judge.reference.pixels().len() * CHANNELS * n_cols];
    let mut cpu_secs = 0.0;
    for column in 0..n_cols {
        let mut light = vec![[0.0; 3]; n_cols];
        light[column] = [1.0; 3];
        let begun = process_cpu_secs()?;
        let picture = traced(subject, scene, &light, Taken { seed: taken.seed + column as u64, ..taken })?;
        cpu_secs += process_cpu_secs()? - begun;
        for (nth, &pixel) in judge.reference.pixels().iter().enumerate() {
            let values = picture[pixel as usize];
            (0..CHANNELS).for_each(|channel| rows[(nth * CHANNELS + channel) * n_cols + column] = values[channel]);
        }
    }
    Ok(taken.point(Way::Renders, cpu_secs, judge.of_rows(&rows)))
}

/// One picture of a look: of all lights of the file, and of a spot, the mean of all spots.
fn plain(subject: &Subject, scene: &Arc<PreparedScene>, judge: &Judge, taken: Taken) -> Result<Vec<Point>> {
    let picture = |light: &Vec<[f32; 3]>| {
        let begun = process_cpu_secs()?;
        let picture = traced(subject, scene, light, taken)?;
        Ok::<_, anyhow::Error>((process_cpu_secs()? - begun, judge.of_picture(light, &picture)))
    };
    let (cpu_secs, db) = picture(&judge.full)?;
    let mut points = vec![taken.point(Way::Plain, cpu_secs, [None, None, db])];
    let spots = judge.spots.iter().filter(|_| taken.spp <= MOST_SPOT_SPP).map(picture).collect::<Result<Vec<_>>>()?;
    if let Some(cpu_secs) = mean(spots.iter().map(|(cpu_secs, _)| *cpu_secs).collect()) {
        let db: Option<Vec<f64>> = spots.iter().map(|(_, db)| *db).collect();
        points.push(taken.point(Way::Plain, cpu_secs, [None, db.and_then(mean), None]));
    }
    Ok(points)
}

fn traced(subject: &Subject, scene: &PreparedScene, light: &[[f32; 3]], taken: Taken) -> Result<Vec<[f32; 3]>> {
    let Taken { spp, seed } = taken;
    Ok(rendered(scene, subject.film, light, &TraceConfig { spp, bounces: None, seed })?.pixels)
}
