//! Cancels: bakes that are given up in each of their stages, and how long their threads take to hear of it.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::sync::mpsc::{Sender, channel};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, ensure};
use clerestory_nystrom::Partition;
use clerestory_transport::bake::focus::Focus;
use clerestory_transport::bake::{BakeConfig, BakeEvent, BakeJob, Passes, SIDE};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::LightingError;
use clerestory_transport::import::{self, ImportError};
use clerestory_transport::irradiance::IrradianceRows;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::skips::Skips;
use clerestory_transport::stop::Stop;

use super::desk::{Desk, program};
use super::goal::Goal;

const FILM: Film = Film { width: 96, height: 72 };
/// Patches for movable lamps.
const PATCHES: u32 = 64;
/// What a person takes for at once, seconds.
const AT_ONCE_SECS: f64 = 0.2;

/// What a bake is at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Columns,
    Preview,
    Blocks,
    Irradiance,
    Packing,
}

impl Stage {
    const ALL: [Stage; 5] = [Stage::Columns, Stage::Preview, Stage::Blocks, Stage::Irradiance, Stage::Packing];

    fn words(self) -> &'static str {
        match self {
            Stage::Columns => "brightness of columns, patches learned",
            Stage::Preview => "preview",
            Stage::Blocks => "patches traced, blocks",
            Stage::Irradiance => "irradiance",
            Stage::Packing => "packing",
        }
    }
}

/// Cancels bakes and tells how long that took.
///
/// # Errors
/// If a scene cannot be read or baked.
pub fn write(desk: &Desk) -> Result<String> {
    let shared = ["conference", "bitterli-staircase2"].map(|name| desk.shared(&format!("scenes/{name}.glb")));
    let scenes = [Some(desk.root.join("assets/scenes/gallery.glb"))].into_iter().chain(shared).flatten();
    let mut rows = String::new();
    for path in scenes.take(desk.choose(1, 3)) {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        rows += &desk.part::<String>("cancel", &name, || of_scene(desk, &name, &path))?;
    }
    Ok(format!(
        "A scene is read, and a bake of it of {} × {} pixels with {PATCHES} patches and irradiance made; both are cancelled at moments\n\
         spread over each of their stages, and the time is taken until all their threads are free. The window itself never waits.\n\
         Asked for, of the slowest answer: {:.0} ms. All bakes are of seed {}.\n\n\
         {}\n\n\
         | scene | stage | lasts, s | cancels | answer, ms, mean | slowest |\n|---|---|---|---|---|---|\n{rows}",
        FILM.width,
        FILM.height,
        1e3 * AT_ONCE_SECS,
        BakeConfig::default().seed,
        desk.provenance("cancel")?,
    ))
}

fn of_scene(desk: &Desk, name: &str, path: &Path) -> Result<String> {
    desk.say(&format!("cancels of {name}"));
    let n_cancels = desk.choose(3, 6);
    let (scene, mut rows) = of_reading(name, path, n_cancels)?;
    let camera = scene.scene.cameras.first().cloned().context("the scene has no camera")?;
    let config = BakeConfig { spp: 8, patches: PATCHES, ..BakeConfig::default() };
    let irradiance = vec![IrradianceRows::Pixels];
    let job = BakeJob { scene, camera, film: FILM, config, passes: Passes::PreviewAndFinal, irradiance };
    let lengths = lengths(&job)?;
    for (stage, secs) in Stage::ALL.into_iter().zip(lengths) {
        rows += &row(["", stage.words()], secs, n_cancels, |after| answer(&job, stage, after))?;
    }
    let (n, slowest) = signals(desk, path, n_cancels)?;
    let slowest = slowest_words((n > 0).then_some(slowest));
    rows += &format!("| | Ctrl-C to the command line, at any moment | | {n} | | {slowest} |\n");
    Ok(rows)
}

/// Reads and builds a scene, and the rows of both.
fn of_reading(name: &str, path: &Path, n_cancels: usize) -> Result<(Arc<PreparedScene>, String)> {
    let begun = Instant::now();
    let scene = import::load(path)?.scene;
    let read_secs = begun.elapsed().as_secs_f64();
    let mut rows = row([name, "reading"], read_secs, n_cancels, |after| {
        stopped(after, |stop| match import::load_until(path, Skips::default(), stop) {
            Err(ImportError::Stopped(_)) => Ok(true),
            read => Ok(read.map(|_| false)?),
        })
    })?;
    let build = |scene, stop: &Stop| PreparedScene::until(scene, &[], None, Skips::default(), stop);
    let own = scene.clone();
    let begun = Instant::now();
    let prepared = build(own, &Stop::default())?.0;
    let tree_secs = begun.elapsed().as_secs_f64();
    rows += &row(["", "trees"], tree_secs, n_cancels, |after| {
        let own = scene.clone();
        stopped(after, |stop| match build(own, stop) {
            Err(LightingError::Stopped(_)) => Ok(true),
            built => Ok(built.map(|_| false)?),
        })
    })?;
    Ok((Arc::new(prepared), rows))
}

/// Asks for a stop some seconds after work began: seconds until it ended, `None` if it had ended before. The work tells
/// whether it was stopped.
fn stopped(after_secs: f64, work: impl FnOnce(&Stop) -> Result<bool>) -> Result<Option<f64>> {
    let stop = Stop::default();
    std::thread::scope(|scope| {
        let asker = scope.spawn(|| {
            std::thread::sleep(Duration::from_secs_f64(after_secs));
            stop.ask();
            Instant::now()
        });
        let was_stopped = work(&stop)?;
        let ended = Instant::now();
        let asked = asker.join().ok().filter(|_| was_stopped);
        Ok(asked.map(|asked| ended.saturating_duration_since(asked).as_secs_f64()))
    })
}

/// A stage that lasts some seconds and is cancelled at moments spread over it.
fn row(
    [scene, stage]: [&str; 2],
    secs: f64,
    n_cancels: usize,
    answer: impl Fn(f64) -> Result<Option<f64>>,
) -> Result<String> {
    let moments = (0..n_cancels).map(|nth| (nth as f64 + 0.5) / n_cancels as f64 * secs);
    let answers = moments.map(answer).collect::<Result<Vec<_>>>()?;
    // The stage of another run may have been over already.
    let answers: Vec<f64> = answers.into_iter().flatten().collect();
    let slowest = answers.iter().copied().reduce(f64::max);
    let n = answers.len();
    let mean = slowest.map_or("—".into(), |_| format!("{:.0}", 1e3 * answers.iter().sum::<f64>() / n as f64));
    Ok(format!("| {scene} | {stage} | {secs:.2} | {n} | {mean} | {} |\n", slowest_words(slowest)))
}

/// Milliseconds of the slowest answer, and whether that is what is asked for; of none nothing is known.
fn slowest_words(secs: Option<f64>) -> String {
    secs.map_or("—".into(), |secs| format!("{:.0}, {}", 1e3 * secs, Goal::Most(AT_ONCE_SECS).word(secs)))
}

/// Follows a bake from stage to stage.
struct Follower {
    /// Blocks of irradiance that are still to come.
    n_irradiance: usize,
    said: Sender<(Stage, Instant)>,
}

impl Follower {
    fn new(said: Sender<(Stage, Instant)>) -> Result<Follower> {
        said.send((Stage::Columns, Instant::now()))?;
        // Those at the rim may be smaller.
        let blocks = Partition { width: FILM.width, height: FILM.height, tile: SIDE };
        Ok(Follower { n_irradiance: blocks.n_blocks(), said })
    }

    fn hear(&mut self, event: &BakeEvent) {
        let stage = match event {
            BakeEvent::Started { .. } => Stage::Preview,
            BakeEvent::PassDone { pass: 0, .. } => Stage::Blocks,
            BakeEvent::PassDone { .. } => Stage::Irradiance,
            BakeEvent::IrradianceDone { is_preview: false, .. } => {
                self.n_irradiance -= 1;
                if self.n_irradiance > 0 {
                    return;
                }
                Stage::Packing
            }
            _ => return,
        };
        // Who has heard enough does not listen any more.
        let _ = self.said.send((stage, Instant::now()));
    }
}

/// How long each stage takes, seconds.
fn lengths(job: &BakeJob) -> Result<[f64; 5]> {
    let (said, heard) = channel();
    let mut follower = Follower::new(said)?;
    let begun = Instant::now();
    let baked = job.clone().run_toward(&Focus::default(), None, |event| {
        follower.hear(&event);
        ControlFlow::Continue(())
    });
    let ended = Instant::now();
    ensure!(baked?.is_some(), "nobody stopped it");
    drop(follower);
    let mut starts: Vec<Instant> = heard.iter().map(|(_, at)| at).collect();
    starts[0] = begun;
    starts.push(ended);
    let lengths: Vec<f64> = starts.windows(2).map(|pair| (pair[1] - pair[0]).as_secs_f64()).collect();
    lengths.try_into().ok().context("a stage is missing")
}

/// Cancels some seconds after a stage began: seconds until nobody works any more, `None` if it had ended before.
fn answer(job: &BakeJob, stage: Stage, after_secs: f64) -> Result<Option<f64>> {
    let focus = Focus::default();
    let (said, heard) = channel();
    let mut follower = Follower::new(said)?;
    let focus = &focus;
    std::thread::scope(|scope| {
        let canceller = scope.spawn(move || {
            let reached = heard.iter().find(|(reached, _)| *reached == stage)?;
            std::thread::sleep(Duration::from_secs_f64(after_secs).saturating_sub(reached.1.elapsed()));
            focus.leave();
            Some(Instant::now())
        });
        let baked = job.clone().run_toward(focus, None, |event| {
            follower.hear(&event);
            ControlFlow::Continue(())
        });
        let ended = Instant::now();
        drop(follower);
        let left = canceller.join().ok().flatten();
        let was_left = baked?.is_none();
        Ok(left.filter(|_| was_left).map(|left| ended.saturating_duration_since(left).as_secs_f64()))
    })
}

/// Interrupts the command line at moments spread over a bake: how often it was still at work, and the slowest answer in seconds.
fn signals(desk: &Desk, scene: &Path, n: usize) -> Result<(usize, f64)> {
    let binary = program()?;
    let output = PathBuf::from(desk.file("interrupted.transport"));
    let start = || {
        let mut command = Command::new(&binary);
        command.arg("bake").arg(scene).arg("-o").arg(&output).args(["--fresh", "--size", "96x72", "--spp", "8"]);
        command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null());
        command.spawn().with_context(|| format!("cannot start {}", binary.display()))
    };
    let begun = Instant::now();
    ensure!(start()?.wait()?.success(), "{} cannot be baked", scene.display());
    let secs = begun.elapsed().as_secs_f64();
    let (mut n_interrupted, mut slowest) = (0, 0.0f64);
    for nth in 0..n {
        let mut child = start()?;
        std::thread::sleep(Duration::from_secs_f64((nth as f64 + 0.5) / n as f64 * secs));
        if child.try_wait()?.is_some() {
            continue;
        }
        let pid = child.id().to_string();
        let asked = Instant::now();
        ensure!(Command::new("kill").args(["-INT", &pid]).status()?.success(), "no signal can be sent");
        child.wait()?;
        (n_interrupted, slowest) = (n_interrupted + 1, slowest.max(asked.elapsed().as_secs_f64()));
    }
    Ok((n_interrupted, slowest))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packing_begins_behind_the_last_block_of_irradiance() {
        let (said, heard) = channel();
        let mut follower = Follower::new(said).unwrap();
        // Six blocks across, and of five down the last ones have half the height.
        for block_idx in 0..30 {
            assert_eq!(heard.try_iter().filter(|(stage, _)| *stage == Stage::Packing).count(), 0, "{block_idx}");
            follower.hear(&BakeEvent::IrradianceDone { set: 0, block_idx, factors: Vec::new(), is_preview: false });
        }
        assert_eq!(heard.try_iter().filter(|(stage, _)| *stage == Stage::Packing).count(), 1);
    }

    #[test]
    fn an_answer_is_at_once_or_late_and_none_is_neither() {
        assert_eq!([Some(0.2), Some(0.25), None].map(slowest_words), ["200, kept", "250, missed", "—"]);
    }
}
