//! Each way measured with growing numbers of samples, in turn.

use std::cell::OnceCell;
use std::sync::Arc;

use anyhow::Result;
use clerestory_nystrom::BlockLowRank;
use clerestory_transport::bake::{BakeConfig, BakeHeader, BakeJob, Indirect, Passes};
use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::light::{LightRig, PanelSpot};
use clerestory_transport::matrix::CHANNELS;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;

use super::{Measured, Point, Subject, Way, prepared};
use crate::desk::Desk;
use crate::matrix::{NO_TOLERANCE_DB, baked, process_cpu_secs};
use crate::reference::{Reference, Sampling, uncompressed};
use crate::rendered::rendered;
use crate::under_way::{ends_a_pass, run_until};

/// Samples per pixel that are tried, as far as they do not take too long.
const SPP: [u32; 6] = [1, 4, 16, 64, 256, 1024];
/// Most samples of pixels of one bake, of one by default, of the renders of one point, of all lights and of some, and of one render: in a
/// hurry, and else.
const MOST_BAKED: [f64; 2] = [5e4, 3.2e6];
const MOST_BY_DEFAULT: [f64; 2] = [5e4, 5e6];
const MOST_TRACED: [f64; 2] = [4e5, 4e7];
const MOST_OF_SOME: [f64; 2] = [4e5, 8e7];
const MOST_PLAIN: [f64; 2] = [4e5, 5.2e7];
/// The same for the one of [`FURTHER`] that is ahead, where it has not come to so many dB of single lights yet: on from there a section
/// would take more than half an hour.
const MOST_FURTHER: [f64; 2] = [0.0, 1.3e7];
pub(super) const FURTHER_DB: f64 = 35.0;
/// Most samples per pixel of a render of a spot.
const MOST_SPOT_SPP: u32 = 256;
/// Lights that are rendered by themselves where all of them take too long.
pub(super) const SOME: usize = 16;
/// Ways of ours, each of which begins with a preview of its own.
const OURS: [Way; 3] = [Way::Default, Way::Fast, Way::Exact];
/// Those that take more samples where that tells more.
const FURTHER: [Way; 2] = [Way::Fast, Way::Exact];
/// Middles of the spots on a panel, and their radius in its shorter sides.
const SPOTS: [[f32; 2]; 3] = [[0.5, 0.5], [0.2, 0.7], [0.85, 0.25]];
const SPOT_RADIUS: f32 = 0.15;
/// The first for all, and more where few samples are taken, to tell how far repeats lie apart.
pub(super) const SEEDS: [u64; 3] = [1, 2, 3];
pub(super) const REPEATED_SPP: u32 = 4;

/// Samples per pixel of each half of most references.
pub(super) const REFERENCE_SPP: u32 = 64;
/// The same of all of them in a hurry.
const QUICK_REFERENCE_SPP: u32 = 16;

/// Samples per pixel of each half of a scene's reference.
pub(super) fn reference_spp(desk: &Desk, subject: &Subject) -> u32 {
    desk.choose(QUICK_REFERENCE_SPP, subject.reference_spp)
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
        let spp = reference_spp(desk, subject);
        let sampling = Sampling { film: subject.film, step: subject.step, bounces: None, spp };
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

    /// The same where some columns alone have rows, as far as these tell.
    fn of_columns(&self, rows: &[f32], columns: &[usize], n_cols: usize) -> [Option<f64>; 3] {
        if columns.len() == n_cols {
            return self.of_rows(rows);
        }
        [self.reference.errors_of(rows, columns).median_db(), None, None]
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

/// A scene beside its reference, both made ready once something is measured that no interrupted run has.
struct Bench<'a> {
    desk: &'a Desk,
    subject: &'a Subject,
    ready: OnceCell<(Arc<PreparedScene>, Judge)>,
}

impl Bench<'_> {
    fn ready(&self) -> Result<(&Arc<PreparedScene>, &Judge)> {
        let (scene, judge) = match self.ready.get() {
            Some(ready) => ready,
            None => {
                let scene = prepared(self.subject)?;
                let judge = Judge::new(self.desk, self.subject, &scene)?;
                self.ready.get_or_init(|| (scene, judge))
            }
        };
        Ok((scene, judge))
    }
}

/// What is known before anything but previews is measured: the number of columns, the dB at which the reference ends, and the previews.
type Begun = (usize, [Option<f64>; 3], Vec<Point>);

/// All points of a scene; those of one number of samples one after the other, so that other work on the machine meets all ways. Each
/// number of samples is a part of the section.
pub(super) fn measure(desk: &Desk, section: &str, subject: &Subject) -> Result<Measured> {
    let (bench, name) = (Bench { desk, subject, ready: OnceCell::new() }, subject.name);
    let (n_cols, ends, points): Begun = desk.part(section, name, || {
        let (scene, judge) = bench.ready()?;
        desk.say(&format!("previewing {name}"));
        let previews = OURS.map(|way| preview(subject, scene, judge, way));
        Ok((scene.lighting.basis.n_cols(), judge.ends(), previews.into_iter().collect::<Result<Vec<_>>>()?))
    })?;
    let mut measured = Measured { n_cols, points, ends };
    for spp in SPP {
        measured.points.extend(desk.part::<Vec<Point>>(section, &format!("{name}, {spp} samples"), || {
            desk.say(&format!("{name} with {spp} samples per pixel, every way"));
            in_turn(&bench, spp)
        })?);
    }
    let curves = FURTHER.map(|way| measured.curve(way, 0));
    let more = || further(&bench, curves.each_ref().map(Vec::as_slice));
    measured.points.extend(desk.part::<Vec<Point>>(section, &format!("{name}, further"), more)?);
    Ok(measured)
}

/// Every way with so many samples per pixel, as far as it does not take too long.
fn in_turn(bench: &Bench<'_>, spp: u32) -> Result<Vec<Point>> {
    let (desk, subject) = (bench.desk, bench.subject);
    let samples = subject.film.n_pixels() as f64 * f64::from(spp);
    let most = |[quick, full]: [f64; 2]| desk.choose(quick, full);
    let (scene, judge) = bench.ready()?;
    let lights = lights(scene.lighting.basis.n_cols(), samples, [MOST_TRACED, MOST_OF_SOME].map(most));
    let n_seeds = if spp == REPEATED_SPP { subject.n_seeds } else { 1 };
    let mut points = Vec::new();
    for taken in SEEDS[..n_seeds].iter().map(|&seed| Taken { spp, seed }) {
        if spp > 1 && samples <= most(MOST_BY_DEFAULT) {
            points.push(ours(subject, scene, judge, Way::Default, taken)?);
        }
        if spp > 1 && samples <= most(MOST_BAKED) {
            for way in FURTHER {
                points.push(ours(subject, scene, judge, way, taken)?);
            }
            points.push(dense(subject, scene, judge, taken)?);
        }
        // Lights by themselves take longest of all, and lie nearest together.
        if taken.seed == SEEDS[0] && !lights.is_empty() {
            points.push(renders(subject, scene, judge, &lights, taken)?);
        }
        if samples <= most(MOST_PLAIN) {
            points.extend(plain(subject, scene, judge, taken)?);
        }
    }
    Ok(points)
}

/// The lights that are rendered by themselves with so many samples of pixels each, given the most of all lights together and of some: all,
/// or, where these are many and take too long, some that lie evenly between the first and the last; none where those do, too.
fn lights(n_cols: usize, samples: f64, [most_of_all, most_of_some]: [f64; 2]) -> Vec<usize> {
    let n = if samples * n_cols as f64 <= most_of_all || n_cols < 2 * SOME { n_cols } else { SOME };
    if samples * n as f64 > most_of_all.max(most_of_some) {
        return Vec::new();
    }
    (0..n).map(|nth| (2 * nth + 1) * n_cols / (2 * n)).collect()
}

/// More points of the one of [`FURTHER`] that is ahead, on from the last of each (CPU seconds, dB of single lights) until it has
/// [`FURTHER_DB`].
fn further(bench: &Bench<'_>, curves: [&[[f64; 2]]; 2]) -> Result<Vec<Point>> {
    let (desk, subject) = (bench.desk, bench.subject);
    let (n_pixels, most) = (subject.film.n_pixels() as f64, desk.choose(MOST_FURTHER[0], MOST_FURTHER[1]));
    let new = |spp: &u32| desk.choose(MOST_BAKED[0], MOST_BAKED[1]) < n_pixels * f64::from(*spp);
    let [shared, traced] = curves.map(|curve| curve.last().map(|[_, db]| *db));
    let (ahead, mut reached) = if traced > shared { (FURTHER[1], traced) } else { (FURTHER[0], shared) };
    let mut points = Vec::new();
    for spp in SPP.into_iter().filter(new).take_while(|spp| n_pixels * f64::from(*spp) <= most) {
        if reached.is_none_or(|db| db >= FURTHER_DB) {
            break;
        }
        let (scene, judge) = bench.ready()?;
        desk.say(&format!("{} with {spp} samples per pixel, {}", subject.name, ahead.name()));
        let point = ours(subject, scene, judge, ahead, Taken { spp, seed: SEEDS[0] })?;
        reached = point.db[0];
        points.push(point);
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

/// The preview of a way, which is the same whatever number of samples follows.
fn preview(subject: &Subject, scene: &Arc<PreparedScene>, judge: &Judge, way: Way) -> Result<Point> {
    let config = preview_config(way);
    let seed = config.seed;
    let begun = process_cpu_secs()?;
    let preview = run_until(job(subject, scene, config), ends_a_pass)?;
    let cpu_secs = process_cpu_secs()? - begun;
    Ok(Point { way, seed, spp: None, cpu_secs, db: judge.of_bake(&preview.header, &preview.groups) })
}

/// That of the bakes that it is told beside.
fn preview_config(way: Way) -> BakeConfig {
    config_of(way, Taken { spp: BakeConfig::default().spp, seed: SEEDS[0] })
}

pub(super) fn job(subject: &Subject, scene: &Arc<PreparedScene>, config: BakeConfig) -> BakeJob {
    let (camera, film) = (scene.scene.cameras[0].clone(), subject.film);
    let passes = Passes::PreviewAndFinal;
    BakeJob { scene: scene.clone(), camera, film, config, passes, irradiance: Vec::new() }
}

/// How a way of ours bakes.
fn config_of(way: Way, Taken { spp, seed }: Taken) -> BakeConfig {
    // What `clerestory bake` does that is told no more than these.
    let usual = BakeConfig { spp, seed, ..BakeConfig::default() };
    match way {
        Way::Fast => BakeConfig { tolerance_db: NO_TOLERANCE_DB, indirect: Indirect::Shared, ..usual },
        // Where light is traced, no pixel tells another.
        Way::Exact => BakeConfig { tolerance_db: NO_TOLERANCE_DB, denoise: false, ..usual },
        _ => usual,
    }
}

fn ours(subject: &Subject, scene: &Arc<PreparedScene>, judge: &Judge, way: Way, taken: Taken) -> Result<Point> {
    let (cpu_secs, bake) = baked(scene, subject.film, config_of(way, taken))?;
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

/// A picture of each of some columns by itself, and the seconds that those of all columns take, if these are like them.
fn renders(
    subject: &Subject,
    scene: &Arc<PreparedScene>,
    judge: &Judge,
    columns: &[usize],
    taken: Taken,
) -> Result<Point> {
    let n_cols = scene.lighting.basis.n_cols();
    let mut rows = vec![0.0; judge.reference.pixels().len() * CHANNELS * n_cols];
    let mut cpu_secs = 0.0;
    for &column in columns {
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
    cpu_secs *= n_cols as f64 / columns.len() as f64;
    Ok(taken.point(Way::Renders, cpu_secs, judge.of_columns(&rows, columns, n_cols)))
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn some_lights_lie_evenly_where_all_take_too_long() {
        let of = |n_cols: usize, samples: f64| lights(n_cols, samples, [64.0, 160.0]);
        assert_eq!(of(4, 10.0), [0, 1, 2, 3]);
        assert_eq!(of(20, 7.0).len(), 20, "few are left out at once");
        assert_eq!(of(64, 2.0), (0..16).map(|nth| 4 * nth + 2).collect::<Vec<_>>());
        assert_eq!(of(64, 1.0).len(), 64);
        assert!(of(64, 11.0).is_empty(), "some take too long as well");
    }

    #[test]
    fn previews_have_the_seed_that_is_told_and_the_settings_of_their_way() {
        let configs = OURS.map(preview_config);
        assert_eq!(configs.each_ref().map(|config| config.seed), [SEEDS[0]; 3]);
        let told = configs.map(|config| (config.indirect, config.denoise));
        assert_eq!(told, [(Indirect::Traced, true), (Indirect::Shared, true), (Indirect::Traced, false)]);
    }

    #[test]
    fn a_bake_by_default_is_told_its_samples_and_nothing_else() {
        let usual = BakeConfig::default();
        let taken = Taken { spp: usual.spp, seed: usual.seed };
        assert_eq!(config_of(Way::Default, taken), usual);
        let (shared, traced) = (config_of(Way::Fast, taken), config_of(Way::Exact, taken));
        assert_eq!((shared.indirect, shared.denoise), (Indirect::Shared, true));
        assert_eq!((traced.indirect, traced.denoise), (Indirect::Traced, false));
    }
}
