//! Skips: work that a scene does not need, and what a bake costs that does it all the same.

mod again;
mod boxed;
mod idle;

use std::ops::ControlFlow;
use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::figures::Skipped;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::skips::{Skip, Skips};
use clerestory_transport::sky::{Environment, SkyForm, SkyLight};

use super::desk::Desk;
use super::errors::{decibels, quantile};
use super::fit::{cpu_words, hundredths, listed, spread_words, tenths, tenths_known};
use super::matrix::process_cpu_secs;
use super::reference::{Reference, Sampling};
use super::rendered::as_in_file;

/// What is asked for, in dB: less than of bakes that are told nothing, which would take hours.
const TOLERANCE_DB: f32 = 30.0;
/// Seeds of each bake, all bakes in turn; in a hurry the first of them alone.
const SEEDS: &[u64] = &[1, 2, 3];
/// How far the seed of another one lies from that of its turn.
const BEYOND: u64 = 100;

/// Scene of `assets/scenes` that is baked again.
const AGAIN: &str = "gallery";

/// One bake with what it took, each time that it was measured.
#[derive(Default)]
struct Run {
    load_secs: Vec<f64>,
    bake_secs: Vec<f64>,
    /// Of the first.
    skipped: Skipped,
    /// RGB under the light of the file.
    pictures: Vec<Vec<f32>>,
    /// See [`Judge::errors_db`].
    errors_db: Vec<[Option<f64>; 2]>,
}

impl Run {
    fn add(&mut self, bake: &Bake, [load_secs, bake_secs]: [f64; 2], judge: &Judge) {
        if self.pictures.is_empty() {
            self.skipped = bake.figures().skipped;
        }
        self.load_secs.push(load_secs);
        self.bake_secs.push(bake_secs);
        self.pictures.push(as_in_file(bake));
        self.errors_db.push(judge.errors_db(bake));
    }
}

/// What is baked.
struct Subject {
    name: &'static str,
    path: PathBuf,
    /// Whether a uniform sky of patches stands over it.
    under_sky: bool,
    /// Whether a lamp is added that a closed box surrounds.
    has_boxed_lamp: bool,
    /// Whether an image is added that nothing samples.
    has_idle_image: bool,
    film: Film,
}

impl Subject {
    /// Rooms of `assets/scenes`, and an open courtyard where it is at hand, of which fewer pixels are baked in a hurry.
    fn all(desk: &Desk, film: Film) -> Vec<Subject> {
        let own = |name: &str| desk.root.join(format!("assets/scenes/{name}.glb"));
        let [under_sky, has_boxed_lamp, has_idle_image] = [false, false, true];
        let room = Subject { name: "gallery", path: own("gallery"), under_sky, has_boxed_lamp, has_idle_image, film };
        let closed = Subject { name: "diffuse", path: own("diffuse"), under_sky: true, has_idle_image: false, ..room };
        let half = Film { width: film.width / 2, height: film.height / 2 };
        let open = desk.shared("references/bench-sponza20.glb").map(|path| Subject {
            name: "sponza20",
            path,
            under_sky: true,
            has_boxed_lamp: true,
            has_idle_image: false,
            film: desk.choose(half, film),
        });
        [room, closed].into_iter().chain(open).collect()
    }

    fn title(&self) -> String {
        let sky = if self.under_sky { " under a uniform sky of patches" } else { "" };
        let lamp = if self.has_boxed_lamp { ", with a lamp in a closed box" } else { "" };
        let image = if self.has_idle_image { ", with an image that nothing samples" } else { "" };
        format!("{}{sky}{lamp}{image}, {} × {} pixels", self.name, self.film.width, self.film.height)
    }

    fn prepared(&self, skips: Skips) -> Result<Arc<PreparedScene>> {
        let Subject { path, under_sky, .. } = self;
        let mut scene =
            import::load_with(path, skips).with_context(|| format!("cannot load {}", path.display()))?.scene;
        if self.has_boxed_lamp {
            boxed::add_lamp(&mut scene);
        }
        let light = SkyLight::new("uniform", Environment::from_fn(16, 8, |_| glam::Vec3::ONE));
        let sky = under_sky.then_some(SkyRequest { light, form: SkyForm::Patches(1) });
        Ok(Arc::new(PreparedScene::with_skips(scene, &[], sky.as_ref(), skips)?.0))
    }
}

/// What the bakes of a scene are held against: samples of which no work was skipped, and the light of the file.
struct Judge {
    reference: Reference,
    /// A coefficient per column.
    light: Vec<[f32; 3]>,
}

impl Judge {
    fn new(desk: &Desk, subject: &Subject) -> Result<Judge> {
        let scene = subject.prepared(Skips::none())?;
        let reference = Reference::new(desk, &[subject.path.as_path()], &scene, sampling(desk, subject.film))?;
        Ok(Judge { reference, light: scene.lighting.basis.project(&LightRig::default()) })
    }

    /// Errors in dB: of single lights, median over columns, and under the light of the file. `None` where nothing is lit.
    fn errors_db(&self, bake: &Bake) -> [Option<f64>; 2] {
        let rows = self.reference.rows_of(&bake.header, &bake.groups);
        let relit = self.reference.relit(&rows, &self.light);
        [self.reference.errors(&rows).median_db(), self.reference.picture_db(&self.light, &relit)]
    }
}

/// Of a reference: few of the picture's pixels, so that it takes less than a bake without any skip.
fn sampling(desk: &Desk, film: Film) -> Sampling {
    Sampling { film, step: 2, bounces: None, spp: desk.choose(8, 64) }
}

fn seeds(desk: &Desk) -> &'static [u64] {
    desk.choose(&SEEDS[..1], SEEDS)
}

/// Bakes scenes with every skip, without each one, and without any.
///
/// # Errors
/// If a scene cannot be baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    let film = desk.choose(Film { width: 32, height: 32 }, Film { width: 96, height: 72 });
    let (spp, usual) = (desk.choose(8, 64), BakeConfig::default());
    let Sampling { step, spp: reference_spp, .. } = sampling(desk, film);
    let mut tables = String::new();
    for subject in Subject::all(desk, film) {
        tables += &desk.part::<String>("skips", subject.name, || table(desk, &subject, spp))?;
    }
    tables += &desk.part::<String>("skips", "again", || again::table(desk, AGAIN, film, spp))?;
    Ok(format!(
        "## Work that is skipped\n\n\
         Bakes asked for {TOLERANCE_DB} dB with at most {spp} samples per pixel (told nothing, bakes ask for {} dB with at most {}, which would take far longer), indirect light traced, no preview: with all\n\
         skips, with each one off alone{}, and with all off. What is found is told of one bake with all skips, of seed {}; figures of the tables are the median (least…greatest) of the seeds {}, all rows in turn with each of them: CPU seconds (user and system) of the whole process, and their ratio\n\
         within a turn. *Picture* holds the picture under the\n\
         light of the file against that with all skips and the same seed: 10·log10(pk² / mean Δ²), pk the 99.5 percentile. Where random numbers\n\
         differ it shows their noise, which the row with other seeds tells. *Single lights* (median) and *all lights* of the file are errors as in the section Error\n\
         against time, beside two references of {reference_spp} samples per pixel each, of pixels that are {step} apart, for which no work was left out. {}\n{tables}",
        usual.tolerance_db,
        usual.spp,
        desk.choose(" (but in sponza20)", ""),
        SEEDS[0],
        listed(seeds(desk)),
        desk.load_words(),
    ))
}

fn table(desk: &Desk, subject: &Subject, spp: u32) -> Result<String> {
    let name = subject.name;
    let mut path = subject.path.clone();
    if subject.has_idle_image {
        path = PathBuf::from(desk.file(&format!("{name}.glb")));
        idle::copy(&subject.path, &path)?;
    }
    let subject = &Subject { path, ..*subject };
    desk.say(&format!("{name}: what its bakes are held against"));
    let judge = Judge::new(desk, subject)?;
    let mut ways = ways();
    if subject.has_boxed_lamp && desk.choose(true, false) {
        // It takes long to load, and each time anew: in a hurry no skip is off alone.
        ways.drain(2..ways.len() - 1);
    }
    let mut runs: Vec<Run> = ways.iter().map(|_| Run::default()).collect();
    for &seed in seeds(desk) {
        for ((what, skips, beyond), run) in ways.iter().zip(&mut runs) {
            desk.say(&format!("baking {name}, {what}, seed {seed}"));
            let (tolerance_db, seed) = (TOLERANCE_DB, seed + beyond);
            let config = BakeConfig { spp, tolerance_db, seed, ..BakeConfig::default() };
            let (bake, secs) = attempt(subject, &config, *skips)?;
            run.add(&bake, secs, &judge);
        }
    }
    let with_all = &runs[0];
    let rows: String = ways.iter().zip(&runs).map(|((what, ..), run)| row(what, run, with_all)).collect();
    Ok(format!(
        "\n### {}\n\n{}\n\n\
         | skips | loading, CPU s | bake, CPU s | against all skips | picture dB | single lights, dB | all lights, dB |\n\
         |---|---|---|---|---|---|---|\n{rows}",
        subject.title(),
        found(&with_all.skipped),
    ))
}

/// With all skips, without each one, and without any: in words, and how far the seed of each lies from that of its turn.
fn ways() -> Vec<(String, Skips, u64)> {
    // Without an earlier bake at hand there is nothing to take over: that has a table of its own.
    let one_off = Skip::ALL.into_iter().filter(|skip| *skip != Skip::Reuse);
    let one_off = one_off.map(|skip| (format!("without {}", skip.name()), Skips::default().without(skip), 0));
    let ends = [("all skips".into(), Skips::default(), 0), ("all skips, other seeds".into(), Skips::default(), BEYOND)];
    ends.into_iter().chain(one_off).chain([("without any".into(), Skips::none(), 0)]).collect()
}

/// A bake, and the CPU seconds that loading its scene and it took.
fn attempt(subject: &Subject, config: &BakeConfig, skips: Skips) -> Result<(Bake, [f64; 2])> {
    let started = process_cpu_secs()?;
    let scene = subject.prepared(skips)?;
    let loaded = process_cpu_secs()?;
    let (camera, config) = (scene.scene.cameras[0].clone(), config.clone());
    let passes = Passes::FinalOnly;
    let job = BakeJob { scene, camera, film: subject.film, config, passes, irradiance: Vec::new() };
    let bake = job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")?;
    Ok((bake, [loaded - started, process_cpu_secs()? - loaded]))
}

fn row(what: &str, run: &Run, with_all: &Run) -> String {
    let of_turns = run.bake_secs.iter().zip(&with_all.bake_secs).map(|(secs, all)| secs / all);
    let pictures = run.pictures.iter().zip(&with_all.pictures).map(|(picture, all)| psnr_db(picture, all));
    let errors_db = |which: usize| run.errors_db.iter().map(|db| db[which]).collect::<Vec<_>>();
    format!(
        "| {what} | {} | {} | {}× | {} | {} | {} |\n",
        cpu_words(run.load_secs.clone()),
        spread_words(run.bake_secs.clone()),
        hundredths(of_turns.collect()),
        pictures_words(&pictures.collect::<Vec<_>>()),
        tenths_known(&errors_db(0)),
        tenths_known(&errors_db(1)),
    )
}

/// How far pictures are from others, as [`psnr_db`] tells it, and how many are the same.
fn pictures_words(dbs: &[Option<f64>]) -> String {
    let differ: Vec<f64> = dbs.iter().copied().flatten().collect();
    match dbs.len() - differ.len() {
        0 => tenths(differ),
        n_same if n_same == dbs.len() => "the same".into(),
        n_same => format!("{}, {n_same} the same", tenths(differ)),
    }
}

/// What a bake tells that it found needless.
fn found(skipped: &Skipped) -> String {
    format!(
        "Found: {:.0} % of the samples in {} converged blocks, {} dark blocks and {} columns that are dark in a block; {} columns of the sky and {} of lamps that light nothing \
         ({:.1} million connections), {} unseen patches, {:.0} % of later connections weak; {} empty pixels; {} diffuse materials, \
         {} opaque triangles; {} images ({:.1} MB of texels).",
        100.0 * skipped.samples_saved,
        skipped.converged_blocks,
        skipped.dark_blocks,
        skipped.dark_columns,
        skipped.closed_sky_columns,
        skipped.dark_lamp_columns,
        skipped.connections_saved / 1e6,
        skipped.sky_patches,
        100.0 * skipped.weak_connections,
        skipped.empty_pixels,
        skipped.diffuse_materials,
        skipped.opaque_triangles,
        skipped.idle_images,
        skipped.idle_image_bytes as f64 / 1e6,
    )
}

/// Decibels by which a picture lies below the 99.5 percentile of another, `None` where they are the same.
fn psnr_db(picture: &[f32], reference: &[f32]) -> Option<f64> {
    let peak = quantile(reference.iter().copied().map(f64::from).collect());
    let square = |(a, b): (&f32, &f32)| f64::from(a - b).powi(2);
    let mean = picture.iter().zip(reference).map(square).sum::<f64>() / reference.len() as f64;
    (mean != 0.0).then(|| decibels(peak, mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_tells_what_a_skip_saves_and_how_far_the_bake_is_off() {
        let run = |bake_secs: [f64; 3], value: f32, all_lights: Option<f64>| Run {
            load_secs: vec![0.01; 3],
            bake_secs: bake_secs.to_vec(),
            skipped: Skipped::default(),
            pictures: vec![vec![value; 100]; 3],
            errors_db: [20.0, 20.5, 21.0].map(|db| [Some(db), all_lights]).into(),
        };
        let with_all = run([2.0, 2.2, 2.4], 1.0, Some(31.3));
        let told = "| all | 0.01 (0.01…0.01) | 2.2 (2.0…2.4) | 1.00 (1.00…1.00)× | the same | 20.5 (20.0…21.0) | 31.3 (31.3…31.3) |\n";
        assert_eq!(row("all", &with_all, &with_all), told);
        let without = run([3.0, 3.3, 3.3], 1.1, None);
        let told = "| none | 0.01 (0.01…0.01) | 3.3 (3.0…3.3) | 1.50 (1.38…1.50)× | 20.0 (20.0…20.0) | 20.5 (20.0…21.0) | — |\n";
        assert_eq!(row("none", &without, &with_all), told);
    }

    #[test]
    fn pictures_that_are_the_same_with_some_seeds_are_counted() {
        assert_eq!(pictures_words(&[None, None]), "the same");
        assert_eq!(pictures_words(&[Some(40.0), Some(41.0), Some(42.0)]), "41.0 (40.0…42.0)");
        assert_eq!(pictures_words(&[None, Some(40.0), None]), "40.0, 2 the same");
    }

    #[test]
    fn a_lamp_in_a_closed_box_is_found_to_light_nothing() {
        let path = PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/scenes/diffuse.glb"));
        let film = Film { width: 16, height: 16 };
        let dark = [false, true].map(|has_boxed_lamp| {
            let [under_sky, has_idle_image] = [false, false];
            let subject =
                Subject { name: "diffuse", path: path.clone(), under_sky, has_boxed_lamp, has_idle_image, film };
            let config = BakeConfig { spp: 2, tolerance_db: TOLERANCE_DB, ..Default::default() };
            attempt(&subject, &config, Skips::default()).unwrap().0.figures().skipped.dark_lamp_columns
        });
        assert_eq!(dark, [0, 1]);
    }

    #[test]
    fn a_picture_is_the_same_as_itself_and_forty_decibels_from_one_that_is_off_by_a_hundredth() {
        let reference: Vec<f32> = (0..1000).map(|i| if i < 900 { 0.5 } else { 2.0 }).collect();
        let off: Vec<f32> = reference.iter().map(|x| x + 0.02).collect();
        assert_eq!(psnr_db(&reference, &reference), None);
        assert!((psnr_db(&off, &reference).expect("they differ") - 40.0).abs() < 1e-3);
        let broken: Vec<f32> = [f32::NAN].into_iter().chain(off[1..].iter().copied()).collect();
        assert_eq!(psnr_db(&broken, &reference), Some(f64::NEG_INFINITY), "no number is not the same");
    }
}
