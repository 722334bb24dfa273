//! The matrix: CPU time and error of its columns, against a converged bake.

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Indirect, Passes};
use clerestory_transport::basis::SourceKind;
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::{Lighting, PanelRequest};
use clerestory_transport::import;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::Scene;

use super::desk::{Desk, process_secs};
use super::errors::ColumnErrors;
use super::fit::{secs_at, tenths};
use super::goal::Goal;
use super::reference::{Reference, Sampling};

/// Scattering events beyond the first, as the peers had them.
pub const BOUNCES: Option<u32> = Some(6);
/// Where CPU seconds are told for.
const TARGETS_DB: [f64; 2] = [30.0, 38.0];

/// A scene and how `peers.md` begins the rows that speak of it.
const SCENES: [(&str, &str); 2] = [("bench-conf64", "| conference, 64 |"), ("bench-sponza20", "| sponza, 20 |")];
/// What is aimed at for each scene: how indirect light is found, an error in dB, and CPU seconds at most.
const AIMS: [(&str, f64, f64); 3] = [("shared", 30.0, 4.0), ("shared", 38.0, 16.0), ("traced", 30.0, 20.0)];
/// The same with many columns.
const AIMS_OF_MANY: [(&str, f64, f64); 1] = [("shared", 30.0, 60.0)];
/// A scene with a panel, and how finely it is divided for a matrix of many columns.
const MANY: (&str, u32) = ("conference-panel", 32);
/// Seeds of the bakes with the fewest samples, which tell how far bakes lie apart; all others have the first.
const SEEDS: [u64; 3] = [1, 2, 3];
/// Out of reach: every block takes all its samples.
const NO_TOLERANCE_DB: f32 = 80.0;

/// What a bake is asked for: samples per pixel at most, and a tolerance in dB.
type Asked = (u32, f32);

/// Bakes each scene with several sample counts and measures every column.
///
/// # Errors
/// If a scene cannot be loaded or baked, or this system does not tell the CPU time of a process.
pub fn write(desk: &Desk) -> Result<String> {
    let (film, step) = desk.choose((Film { width: 64, height: 48 }, 1), (Film { width: 512, height: 384 }, 4));
    let (samples, spp): (&[u32], u32) = desk.choose((&[4, 16], 16), (&[4, 16, 64], 128));
    let to_tolerance = desk.choose(&[][..], &[(64, 24.0), (64, 26.0), (64, 28.0), (64, 34.0), (64, 36.0), (64, 38.0)]);
    let asked: Vec<Asked> = samples.iter().map(|&spp| (spp, NO_TOLERANCE_DB)).chain(to_tolerance.to_vec()).collect();
    let sampling = Sampling { film, step, bounces: BOUNCES, spp };
    let mut scenes = String::new();
    for (name, peers) in SCENES {
        let Some(path) = desk.shared(&format!("references/{name}.glb")) else { continue };
        scenes += &desk.part("matrix", name, || scene(desk, (name, None), &path, sampling, &asked))?;
        scenes += &quoted(desk, peers)?;
    }
    let (name, resolution) = MANY;
    if let Some(path) = desk.shared(&format!("scenes/{name}.glb")).filter(|_| !desk.quick) {
        let sampling = Sampling { spp: spp / 4, ..sampling };
        let asked = [(4, NO_TOLERANCE_DB), (8, NO_TOLERANCE_DB), (32, 20.0), (32, 23.0), (32, 26.0), (32, 30.0)];
        scenes += &desk.part("matrix", name, || scene(desk, (name, Some(resolution)), &path, sampling, &asked))?;
    }
    Ok(format!(
        "## Matrix\n\n\
         {} × {} pixels, six bounces, one bake per row, its indirect light shared between pixels or traced and not denoised, as with `--no-denoise`; CPU\n\
         seconds (user and system) of the bake alone, without loading and without preview. The error of a column is the mean of\n\
         (x − a)(x − b) over its entries, x baked, a and b two independent references of {spp} samples per pixel each that are not\n\
         compressed{}: so their noise does not count, but no error is told as less than its standard error. It is told in dB below the square of the reference column's 99.5 percentile;\n\
         nothing is clipped. Entries of a pixel that shows the column's own light, or beside one that does, are left out; the last\n\
         column has them too: there the light itself is seen, far brighter than the peak of what it lights, so that an edge of it in a pixel costs many dB, and less than none is an error greater than that peak. Where a tolerance is told, a block takes samples until its own error is below it; CPU seconds for a\n\
         number of dB lie between two rows of a kind. All bakes have seed 1, the references another; those with the fewest samples have {} more, \
         and their seconds and mean dB are the median (least…greatest). Where bakes with shared light miss the seconds that are aimed at, [decision 0035](decisions/0035-colors-of-a-chessboard-judge-each-other.md) tells what they are spent on. {}\n{scenes}",
        film.width,
        film.height,
        if step == 1 { String::new() } else { format!(", of every {step}th pixel across and down") },
        SEEDS.len() - 1,
        desk.load_words(),
    ))
}

fn scene(
    desk: &Desk,
    (name, resolution): (&str, Option<u32>),
    path: &Path,
    sampling: Sampling,
    asked: &[Asked],
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
    let (mut rows, mut targets) = (String::new(), String::new());
    for (indirect, way) in [(Indirect::Shared, "shared"), (Indirect::Traced, "traced")] {
        let mut measured = [Vec::new(), Vec::new()];
        for &(spp, tolerance_db) in asked {
            desk.say(&format!("baking {name} with {spp} samples per pixel, indirect light {way}"));
            // Where light is traced, no pixel tells another.
            let denoise = indirect == Indirect::Shared;
            let bake = |seed: u64| {
                let config = BakeConfig {
                    spp,
                    tolerance_db,
                    bounces: BOUNCES,
                    seed,
                    indirect,
                    denoise,
                    ..BakeConfig::default()
                };
                let (secs, bake) = baked(&scene, sampling.film, config)?;
                let errors = reference.errors(&reference.rows_of(&bake.header, &bake.groups));
                Ok::<_, anyhow::Error>((secs, bake, errors))
            };
            let (secs, first, errors) = bake(SEEDS[0])?;
            measured[usize::from(tolerance_db < NO_TOLERANCE_DB)].push([secs, errors.mean_db()]);
            let (mut all_secs, mut all_db) = (vec![secs], vec![errors.mean_db()]);
            // How far bakes lie apart is told by the cheapest.
            for &seed in SEEDS[1..].iter().filter(|_| (spp, tolerance_db) == asked[0]) {
                let (secs, _, errors) = bake(seed)?;
                all_secs.push(secs);
                all_db.push(errors.mean_db());
            }
            rows += &row(((spp, tolerance_db), way), [all_secs, all_db], &first, &errors);
        }
        targets += &words_of_targets(way, &measured);
        let aims = if resolution.is_some() { &AIMS_OF_MANY[..] } else { &AIMS };
        targets += &words_of_aims(way, aims, &measured);
    }
    Ok(format!(
        "\n### {name}\n\n\
         {} columns, {} triangles; finding lights and building the hierarchy took {prepared:.1} CPU seconds beside.{targets}\n\n\
         | samples | indirect light | CPU s | rank mean / max | dense / factors | column dB mean | worst | with lights seen, mean / worst |\n\
         |---|---|---|---|---|---|---|---|\n{rows}",
        scene.lighting.basis.n_cols(),
        scene.scene.mesh.triangles.len(),
    ))
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

fn row(
    ((spp, tolerance_db), way): (Asked, &str),
    [secs, db]: [Vec<f64>; 2],
    bake: &Bake,
    errors: &ColumnErrors,
) -> String {
    let figures = bake.figures();
    let samples =
        if tolerance_db < NO_TOLERANCE_DB { format!("≤ {spp}, to {tolerance_db} dB") } else { spp.to_string() };
    format!(
        "| {samples} | {way} | {} | {:.1} / {} | {:.0}× | {} | {:.1} | {:.1} / {:.1} |\n",
        tenths(secs),
        figures.mean_rank,
        figures.max_rank,
        figures.ratio,
        tenths(db),
        errors.worst_db(),
        errors.mean_db_with_seen(),
        errors.worst_db_with_seen(),
    )
}

/// CPU seconds at which the targets lie between two rows, of fixed samples and of tolerances.
fn words_of_targets(way: &str, measured: &[Vec<[f64; 2]>; 2]) -> String {
    let of = |db: f64| {
        let known = measured.iter().zip(["with fixed samples", "to a tolerance"]);
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

/// Whether the least of these CPU seconds keeps what is aimed at.
fn words_of_aims(way: &str, aims: &[(&str, f64, f64)], measured: &[Vec<[f64; 2]>; 2]) -> String {
    let of_way = aims.iter().filter(|(of, ..)| *of == way);
    let words = of_way.map(|(_, db, most)| {
        let least = measured.iter().filter_map(|rows| secs_at(*db, rows)).reduce(f64::min);
        let word = least.map_or("not known from these rows", |secs| Goal::Most(*most).word(secs));
        format!("{db} dB in {most} CPU seconds, {word}")
    });
    let words: Vec<String> = words.collect();
    if words.is_empty() { String::new() } else { format!(" Aimed at: {}.", words.join("; ")) }
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
    use super::*;

    #[test]
    fn an_aim_is_kept_by_the_sooner_of_both_kinds_of_rows() {
        let measured = [vec![[1.0, 20.0], [9.0, 40.0]], vec![[2.0, 25.0], [8.0, 35.0]]];
        let aims = [("shared", 30.0, 3.5), ("traced", 30.0, 1.0)];
        assert_eq!(words_of_aims("shared", &aims, &measured), " Aimed at: 30 dB in 3.5 CPU seconds, kept.");
        assert_eq!(
            words_of_aims("shared", &[("shared", 30.0, 2.5)], &measured),
            " Aimed at: 30 dB in 2.5 CPU seconds, missed."
        );
        let words = words_of_aims("traced", &[("traced", 50.0, 1.0)], &measured);
        assert!(words.ends_with("not known from these rows."), "{words}");
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
