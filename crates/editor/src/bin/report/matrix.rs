//! The matrix: CPU time and error of its columns, against a converged bake.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context, Result, ensure};
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Indirect, Passes};
use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::{Lighting, PanelRequest};
use clerestory_transport::figures::Figures;
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::Scene;

use super::desk::{Desk, process_secs};
use super::errors::ColumnErrors;
use super::fit::{digits, listed, secs_at, spread, tenths};
use super::goal::Goal;
use super::reference::{Reference, Sampling};

/// The section of a panel with many columns, by itself for its time.
pub const PANEL: &str = "matrix-panel";

/// Scattering events beyond the first, as the peers had them.
pub const BOUNCES: Option<u32> = Some(6);
/// The pixels of the full report.
const FULL_FILM: Film = Film { width: 512, height: 384 };
/// Where CPU seconds are told for.
const TARGETS_DB: [f64; 2] = [30.0, 38.0];

/// A scene, how `peers.md` begins the rows that speak of it, and the CPU seconds at [`PEERS_DB`] that it has for the best of the peers whose picture is right:
/// held against converged bakes the one, for two of them by their own metric the other.
const SCENES: [(&str, &str, &[f64]); 2] =
    [("bench-conf64", "| conference, 64 |", &[575.0]), ("bench-sponza20", "| sponza, 20 |", &[341.0, 415.0])];
const PEERS_DB: f64 = 30.0;
/// What is aimed at for each scene: how indirect light is found, an error in dB, and CPU seconds at most.
const AIMS: [(&str, f64, f64); 3] = [("shared", 30.0, 4.0), ("shared", 38.0, 16.0), ("exact", 30.0, 20.0)];
/// The same with many columns.
const AIMS_OF_MANY: [(&str, f64, f64); 1] = [("shared", 30.0, 60.0)];
/// A scene with a panel, and how finely it is divided for a matrix of many columns.
const MANY: (&str, u32) = ("conference-panel", 32);
/// Seeds of a row; in a hurry all of the first row alone.
const SEEDS: [u64; 3] = [1, 2, 3];
/// What it is held against: few pixels with many samples, for noise that stands in one pixel of a hundred falls with samples twice as fast.
const STEP_OF_MANY: u32 = 8;
const SPP_OF_MANY: u32 = 1024;
/// A bake that takes more CPU seconds has the first seed alone, so that the section stays within half an hour on two cores.
const MOST_SECS: f64 = 70.0;
/// Out of reach: every block of [`baked`] takes all its samples.
pub const NO_TOLERANCE_DB: f32 = 80.0;

/// What a bake is asked for: samples per pixel at most, and a tolerance in dB.
type Asked = (u32, f32);

/// Rows of one way to find indirect light: CPU seconds and mean dB of each, of fixed samples and of tolerances.
type Points = [Vec<[f64; 2]>; 2];
/// What these are called.
const KINDS: [&str; 2] = ["with fixed samples", "to a tolerance"];

/// Bakes each scene with several sample counts and measures every column.
///
/// # Errors
/// If none of its scenes is here, one cannot be loaded or baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    ensure!(has_scenes(desk), "its scenes lie in the folder that CLERESTORY_SHARED names, and are not there");
    let (film, step) = desk.choose((Film { width: 64, height: 48 }, 1), (FULL_FILM, 4));
    let (samples, spp): (&[u32], u32) = desk.choose((&[4, 16], 16), (&[4, 16, 64], 128));
    let to_tolerance = desk.choose(&[][..], &[(64, 26.0), (64, 28.0), (64, 34.0), (64, 38.0)]);
    let asked: Vec<Asked> = samples.iter().map(|&spp| (spp, NO_TOLERANCE_DB)).chain(to_tolerance.to_vec()).collect();
    let sampling = Sampling { film, step, bounces: BOUNCES, spp };
    let mut scenes = String::new();
    for (name, peers, peers_secs) in SCENES {
        let Some(path) = path_of(desk, name) else { continue };
        scenes += &desk.part("matrix", name, || scene(desk, (name, None, peers_secs), &path, sampling, &asked))?;
        scenes += &quoted(desk, peers)?;
    }
    Ok(format!(
        "## Matrix\n\n\
         {} × {} pixels, six bounces, bakes whose indirect light is shared between pixels, as with `--fast`, or traced without any filter, as with `--exact`; CPU\n\
         seconds (user and system) of the bake alone, without loading and without preview. The error of a column is the mean of\n\
         (x − a)(x − b) over its entries, x baked, a and b two independent references that are not compressed: so their noise does not count, but no\n\
         error is told as less than its standard error over the pixels: “≥” where that is so of more than half of the columns, or of the worst. It is told in dB below the square of the reference column's 99.5 percentile;\n\
         nothing is clipped. Entries of a pixel that shows the column's own light, or beside one that does, are left out; the last\n\
         column has them too: there the light itself is seen, far brighter than the peak of what it lights, so that an edge of it in a pixel costs many dB, and less than none is an error greater than that peak. Where a tolerance is told, a block takes samples until its own error is below it; CPU seconds for a\n\
         number of dB lie between the medians of two rows of a kind, with fixed samples or to a tolerance, and what is aimed at is told of each kind by itself. Told bias is `error_db.bias`, what a bake itself says of sharing by pixels that it traces as well, no better than its own standard error. \
         Rows have {}; the references have another seed. CPU seconds, mean and worst dB are the median (least…greatest), all else is that of seed {}. Where bakes with shared light miss the seconds that are aimed at, [decision 0035](decisions/0035-colors-of-a-chessboard-judge-each-other.md) tells what they are spent on. {}\n{scenes}",
        film.width,
        film.height,
        seeds_words(desk),
        SEEDS[0],
        desk.load_words(),
    ))
}

/// Whether any of the scenes of [`write()`] is here: without them the page keeps what was measured elsewhere.
pub fn has_scenes(desk: &Desk) -> bool {
    SCENES.iter().any(|(name, ..)| path_of(desk, name).is_some())
}

fn path_of(desk: &Desk, name: &str) -> Option<PathBuf> {
    desk.shared(&format!("references/{name}.glb"))
}

/// The same of a panel that is divided into many columns.
///
/// # Errors
/// If its scene is missing, cannot be loaded or baked, or this system does not tell the CPU time of a process.
pub fn write_panel(desk: &Desk) -> Result<String> {
    let (name, resolution) = MANY;
    let path = panel_scene(desk).with_context(|| format!("the scene {name} is missing"))?;
    let sampling = Sampling { film: FULL_FILM, step: STEP_OF_MANY, bounces: BOUNCES, spp: SPP_OF_MANY };
    let asked = [(4, NO_TOLERANCE_DB), (8, NO_TOLERANCE_DB), (32, 23.0), (32, 26.0)];
    let text = desk.part(PANEL, name, || scene(desk, (name, Some(resolution), &[]), &path, sampling, &asked))?;
    Ok(format!(
        "## Matrix of a panel\n\n\
         The same as in [Matrix](#matrix), where its words are explained, of a panel divided into {resolution} × {resolution} texels: {} × {} pixels, six\n\
         bounces. Rows have {}. {}\n{text}",
        sampling.film.width,
        sampling.film.height,
        seeds_words(desk),
        desk.load_words(),
    ))
}

/// Whether the scene of [`write_panel`] is here.
pub fn has_panel(desk: &Desk) -> bool {
    panel_scene(desk).is_some()
}

fn panel_scene(desk: &Desk) -> Option<PathBuf> {
    desk.shared(&format!("scenes/{}.glb", MANY.0))
}

fn scene(
    desk: &Desk,
    (name, resolution, peers_secs): (&str, Option<u32>, &[f64]),
    path: &Path,
    sampling: Sampling,
    asked_of_all: &[Asked],
) -> Result<String> {
    let imported = import::load(path).with_context(|| format!("cannot load the scene {}", path.display()))?;
    let panels = match resolution {
        None => Vec::new(),
        Some(resolution) => vec![divided(&imported.scene, resolution)?],
    };
    let before = process_cpu_secs()?;
    let scene = Arc::new(PreparedScene::new(imported.scene, &panels)?.0);
    let prepared = process_cpu_secs()? - before;
    desk.say(&format!("{name}: what its bakes are held against"));
    let reference = Reference::new(desk, &[path], &scene, sampling)?;
    let (mut rows, mut targets, mut worst) = (String::new(), String::new(), Vec::<String>::new());
    for (indirect, way) in [(Indirect::Shared, "shared"), (Indirect::Traced, "exact")] {
        let mut points: Points = [Vec::new(), Vec::new()];
        let mut worst_of_most = None;
        for &asked in asked_of_all {
            desk.say(&format!("baking {name} with {} samples per pixel, indirect light {way}", asked.0));
            let first_alone = desk.quick && asked != asked_of_all[0];
            let repeats = repeats(&scene, (&reference, sampling.film), (asked, indirect), first_alone)?;
            points[usize::from(asked.1 < NO_TOLERANCE_DB)].push(repeats.middle());
            rows += &repeats.row(asked, way);
            if asked.1 >= NO_TOLERANCE_DB {
                worst_of_most = repeats.worst_words(asked.0, way);
            }
        }
        worst.extend(worst_of_most);
        targets += &words_of_targets(way, &points);
        let aims = if resolution.is_some() { &AIMS_OF_MANY[..] } else { &AIMS };
        targets += &words_of_aims(way, aims, &points);
        targets += &words_of_peers(peers_secs, &points);
    }
    let worst = if worst.is_empty() { String::new() } else { format!("\nThe worst light: {}.\n", worst.join("; ")) };
    Ok(format!(
        "\n### {name}\n\n\
         {} columns, {} triangles; finding lights and building the hierarchy took {prepared:.1} CPU seconds beside. {}{targets}\n\n\
         {HEAD}{rows}{worst}",
        scene.lighting.basis.n_cols(),
        scene.scene.mesh.triangles.len(),
        words_of_references(sampling),
    ))
}

fn words_of_references(Sampling { step, spp, .. }: Sampling) -> String {
    let pixels = if step == 1 { "all pixels".into() } else { format!("every {step}th pixel across and down") };
    format!("References of {spp} samples per pixel, of {pixels}.")
}

/// The first panel of a scene, in other texels.
pub fn divided(scene: &Scene, resolution: u32) -> Result<PanelRequest> {
    let lighting = Lighting::new(scene, &[])?.0;
    let mut sources = lighting.basis.sources.iter();
    let panel = sources.find(|source| matches!(source.kind, SourceKind::Panel { .. })).context("it has no panel")?;
    Ok(PanelRequest { node: panel.key.clone(), resolution })
}

/// A bake without preview, and the CPU seconds that it took.
pub fn baked(scene: &Arc<PreparedScene>, film: Film, config: BakeConfig) -> Result<(f64, Bake)> {
    let camera = scene.scene.cameras[0].clone();
    let job = BakeJob { scene: scene.clone(), camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let before = process_cpu_secs()?;
    let bake = job.run(|_| ControlFlow::Continue(()))?.context("nobody stops a bake of the report")?;
    Ok((process_cpu_secs()? - before, bake))
}

/// Head of the table of a scene.
const HEAD: &str = "| samples | indirect light | CPU s | rank mean / max | dense / packed factors | column dB mean | worst | with lights seen, mean / worst | told bias |\n\
    |---|---|---|---|---|---|---|---|---|\n";

/// Bakes of one row.
struct Repeats {
    /// Of each seed.
    secs: Vec<f64>,
    errors: Vec<ColumnErrors>,
    /// Of the first.
    mean_rank: f32,
    max_rank: u32,
    /// Dense over the bytes of the factors as a file holds them, of the first.
    ratio: f32,
    /// Whose column is the worst, of the first.
    worst_light: Option<String>,
    /// What each bake tells of sharing, dB; none where light is traced.
    bias_db: Vec<f64>,
}

/// Bakes with every seed, or with the first alone where that takes long.
fn repeats(
    scene: &Arc<PreparedScene>,
    (reference, film): (&Reference, Film),
    ((spp, tolerance_db), indirect): (Asked, Indirect),
    first_alone: bool,
) -> Result<Repeats> {
    let bake = |seed: u64| {
        // Where light is traced, no pixel tells another, and no number of a block another one.
        let noise_is_taken_out = indirect == Indirect::Shared;
        let (denoise, smooth) = (noise_is_taken_out, noise_is_taken_out);
        let bounces = BOUNCES;
        let config =
            BakeConfig { spp, tolerance_db, bounces, seed, indirect, denoise, smooth, ..BakeConfig::default() };
        let (secs, bake) = baked(scene, film, config)?;
        let errors = reference.errors(&reference.rows_of(&bake.header, &bake.groups));
        Ok::<_, anyhow::Error>((secs, errors, bake))
    };
    let (first_secs, errors, first) = bake(SEEDS[0])?;
    let Figures { mean_rank, max_rank, ratio, .. } = first.figures();
    let worst = errors.worst().and_then(|nth| reference.column_of(nth));
    let worst_light = worst.and_then(|column| light_of(&first.header.basis, column as u32));
    let bias = |bake: &Bake| bake.figures().error_db.bias.map(f64::from);
    let bias_db = bias(&first).into_iter().collect();
    let (secs, errors) = (vec![first_secs], vec![errors]);
    let mut repeats = Repeats { secs, errors, mean_rank, max_rank, ratio, worst_light, bias_db };
    for &seed in SEEDS[1..].iter().filter(|_| !first_alone && first_secs <= MOST_SECS) {
        let (secs, errors, other) = bake(seed)?;
        repeats.bias_db.extend(bias(&other));
        repeats.secs.push(secs);
        repeats.errors.push(errors);
    }
    Ok(repeats)
}

impl Repeats {
    fn mean_db(&self) -> Vec<f64> {
        self.errors.iter().map(ColumnErrors::mean_db).collect()
    }

    /// Median CPU seconds and mean dB.
    fn middle(&self) -> [f64; 2] {
        [&self.secs, &self.mean_db()].map(|values| spread(values)[1])
    }

    /// The worst light and its error.
    fn worst_words(&self, spp: u32, way: &str) -> Option<String> {
        let light = self.worst_light.as_ref()?;
        let first = &self.errors[0];
        let db = at_least(first.is_worst_bound(), format!("{:.1} dB", first.worst_db()));
        Some(format!("indirect light {way}, {spp} samples, {light}, {db}"))
    }

    fn row(&self, (spp, tolerance_db): Asked, way: &str) -> String {
        let Repeats { secs, errors, mean_rank, max_rank, ratio, bias_db, .. } = self;
        let bias = if bias_db.is_empty() { "—".into() } else { tenths(bias_db.clone()) };
        let samples =
            if tolerance_db < NO_TOLERANCE_DB { format!("≤ {spp}, to {tolerance_db} dB") } else { spp.to_string() };
        format!(
            "| {samples} | {way} | {} | {mean_rank:.1} / {max_rank} | {ratio:.0}× | {} | {} | {:.1} / {:.1} | {bias} |\n",
            tenths(secs.clone()),
            at_least(errors.iter().any(ColumnErrors::is_mostly_bound), tenths(self.mean_db())),
            at_least(
                errors.iter().any(ColumnErrors::is_worst_bound),
                tenths(errors.iter().map(ColumnErrors::worst_db).collect())
            ),
            errors[0].mean_db_with_seen(),
            errors[0].worst_db_with_seen(),
        )
    }
}

/// Words of a figure that may be a bound.
fn at_least(is_bound: bool, words: String) -> String {
    if is_bound { format!("≥ {words}") } else { words }
}

/// The light that a column is of, by its key; of a light with several columns which of them it is, from 0.
fn light_of(basis: &LightBasis, column: u32) -> Option<String> {
    let source = basis.sources.iter().find(|source| source.columns.contains(&column))?;
    let nth = column - source.columns.start;
    Some(if source.columns.len() > 1 { format!("`{}`, column {nth}", source.key) } else { format!("`{}`", source.key) })
}

/// Which seeds rows have.
fn seeds_words(desk: &Desk) -> String {
    let all = listed(&SEEDS);
    let first = SEEDS[0];
    desk.choose(
        format!("seed {first}, the first ones the seeds {all}"),
        format!(
            "the seeds {all}, but those whose bake takes more than {MOST_SECS} CPU seconds have seed {first} alone, or the section would take \
             longer than half an hour: how far seeds lie apart is told by the other rows"
        ),
    )
}

/// CPU seconds at which the targets lie between two rows, of fixed samples and of tolerances.
fn words_of_targets(way: &str, points: &Points) -> String {
    let of = |db: f64| {
        let known = points.iter().zip(KINDS);
        let words: Vec<String> =
            known.filter_map(|(rows, how)| Some(format!("{:.1} CPU seconds {how}", secs_at(db, rows)?))).collect();
        if words.is_empty() {
            format!("no two rows lie on both sides of {db} dB")
        } else {
            format!("{db} dB take {}", words.join(" or "))
        }
    };
    format!(" Indirect light {way}: {}.", TARGETS_DB.map(of).join("; "))
}

/// Whether the CPU seconds of each kind of rows keep what is aimed at.
fn words_of_aims(way: &str, aims: &[(&str, f64, f64)], points: &Points) -> String {
    let of_way = aims.iter().filter(|(of, ..)| *of == way);
    let words = of_way.map(|(_, db, most)| {
        let of_kind = |(rows, kind): (&Vec<[f64; 2]>, &str)| match secs_at(*db, rows) {
            Some(secs) => format!("{kind} {} ({secs:.1})", Goal::Most(*most).word(secs)),
            None => format!("{kind} not known"),
        };
        let kinds: Vec<String> = points.iter().zip(KINDS).map(of_kind).collect();
        format!("{db} dB in {most} CPU seconds: {}", kinds.join(", "))
    });
    let words: Vec<String> = words.collect();
    if words.is_empty() { String::new() } else { format!(" Aimed at: {}.", words.join("; ")) }
}

/// How many times the least of these CPU seconds other renderers took, by what is quoted of them.
fn words_of_peers(peers_secs: &[f64], points: &Points) -> String {
    let least = points.iter().filter_map(|rows| secs_at(PEERS_DB, rows)).reduce(f64::min);
    let Some(own) = least.filter(|_| !peers_secs.is_empty()) else { return String::new() };
    let joined = |of: &dyn Fn(f64) -> String| peers_secs.iter().map(|&secs| of(secs)).collect::<Vec<_>>().join("–");
    format!(
        " For {PEERS_DB} dB the best of the other renderers quoted below took {} CPU seconds (another machine, another day), {} times the least of these.",
        joined(&|secs| secs.to_string()),
        joined(&|secs| digits(secs / own)),
    )
}

/// What the study of the peers says about a scene, word for word.
fn quoted(desk: &Desk, rows: &str) -> Result<String> {
    let Some(path) = desk.shared("references/peers.md") else { return Ok(String::new()) };
    let text = std::fs::read_to_string(&path).with_context(|| format!("cannot read {}", path.display()))?;
    let of_table =
        |line: &&str| line.starts_with("| scene, lights") || line.starts_with("|---") || line.starts_with(rows);
    let table: Vec<String> = text.lines().filter(of_table).map(|line| format!("> {line}")).collect();
    let caution = text.lines().skip_while(|line| !line.starts_with("Caution")).take_while(|line| !line.is_empty());
    let caution: Vec<String> = caution.map(|line| format!("> {line}")).collect();
    Ok(format!(
        "\nOther renderers, quoted from an earlier study of them on these scenes (another day, another machine, and a metric of its own,\n\
         of which it warns itself):\n\n{}\n>\n{}\n",
        table.join("\n"),
        caution.join("\n"),
    ))
}

/// CPU seconds of all threads of this process so far, user and system.
pub fn process_cpu_secs() -> Result<f64> {
    let told = std::fs::read_to_string("/proc/self/stat").context("only Linux tells the CPU time of a process")?;
    let [own, _] = process_secs(&told).context("/proc/self/stat has no user and system time")?;
    Ok(own)
}

#[cfg(test)]
mod tests {
    use clerestory_transport::basis::LightSource;
    use clerestory_transport::origin::LightOrigin;
    use glam::Vec3;

    use super::*;

    #[test]
    fn an_aim_is_kept_or_missed_by_each_kind_of_rows() {
        let points = [vec![[1.0, 20.0], [9.0, 40.0]], vec![[2.0, 25.0], [8.0, 35.0]]];
        assert_eq!(
            words_of_aims("shared", &[("shared", 30.0, 3.5), ("traced", 30.0, 1.0)], &points),
            " Aimed at: 30 dB in 3.5 CPU seconds: with fixed samples kept (3.0), to a tolerance missed (4.0)."
        );
        assert_eq!(
            words_of_aims("shared", &[("shared", 38.0, 9.0)], &points),
            " Aimed at: 38 dB in 9 CPU seconds: with fixed samples kept (7.2), to a tolerance not known."
        );
        assert_eq!(words_of_aims("traced", &[("shared", 30.0, 1.0)], &points), "");
    }

    #[test]
    fn a_row_tells_all_its_seeds_and_points_have_their_medians() {
        let errors = |db: f64| {
            let square = 10f64.powf(-db / 10.0);
            ColumnErrors { squares: vec![[square, 10.0 * square]], are_bounds: vec![false] }
        };
        let mut repeats = Repeats {
            secs: vec![2.0, 5.0, 3.0],
            errors: [30.0, 32.0, 31.0].map(errors).into(),
            mean_rank: 1.5,
            max_rank: 9,
            ratio: 800.0,
            worst_light: Some("`lamp`".into()),
            bias_db: vec![41.0],
        };
        let [secs, db] = repeats.middle();
        assert!(secs == 3.0 && (db - 31.0).abs() < 1e-9, "{secs} {db}");
        let told = repeats.row((64, 26.0), "shared");
        assert!(told.starts_with("| ≤ 64, to 26 dB | shared | 3.0 (2.0…5.0) | 1.5 / 9 | 800× | "), "{told}");
        assert!(told.ends_with(" | 31.0 (30.0…32.0) | 31.0 (30.0…32.0) | 20.0 / 20.0 | 41.0 |\n"), "{told}");
        // Packed bytes are what a dense matrix is held against, not the factors in memory.
        assert!(HEAD.contains("| dense / packed factors |"), "{HEAD}");
        let n_cells = |line: &str| line.matches('|').count();
        assert!(HEAD.lines().all(|line| n_cells(line) == n_cells(&told)), "{told}");
        let worst = repeats.worst_words(64, "shared");
        assert_eq!(worst.as_deref(), Some("indirect light shared, 64 samples, `lamp`, 30.0 dB"));
        repeats.errors[0].are_bounds = vec![true];
        let worst = repeats.worst_words(64, "shared").expect("a light");
        assert!(worst.ends_with("`lamp`, ≥ 30.0 dB"), "{worst}");
    }

    #[test]
    fn quoted_peers_are_told_as_multiples_of_our_least_seconds() {
        let points = [vec![[1.0, 20.0], [9.0, 40.0]], vec![[2.0, 25.0], [8.0, 35.0]]];
        let told = words_of_peers(&[300.0, 420.0], &points);
        assert!(told.contains("took 300–420 CPU seconds (another machine, another day), 100–140 times"), "{told}");
        assert_eq!(words_of_peers(&[], &points), "");
        assert_eq!(words_of_peers(&[300.0], &[vec![[1.0, 10.0], [9.0, 20.0]], Vec::new()]), "");
    }

    #[test]
    fn the_worst_column_has_the_name_of_its_light() {
        let source = |key: &str, columns: std::ops::Range<u32>| LightSource {
            key: key.into(),
            kind: SourceKind::Point,
            columns,
            color: Vec3::ONE,
            strength: 1.0,
            origin: LightOrigin::default(),
        };
        let basis = LightBasis { sources: vec![source("lamp", 0..1), source("panel", 1..17)], ..LightBasis::default() };
        assert_eq!(light_of(&basis, 0).as_deref(), Some("`lamp`"));
        assert_eq!(light_of(&basis, 16).as_deref(), Some("`panel`, column 15"));
        assert_eq!(light_of(&basis, 17), None);
    }

    #[test]
    fn cpu_time_grows_with_work() {
        let before = process_cpu_secs().unwrap();
        let started = std::time::Instant::now();
        while started.elapsed().as_millis() < 200 {
            std::hint::black_box((0..1000u32).sum::<u32>());
        }
        assert!(process_cpu_secs().unwrap() > before);
    }
}
