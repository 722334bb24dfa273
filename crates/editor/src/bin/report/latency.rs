//! From an event of the pointer to the picture, through the editor as it is, without a window.

mod painter;
mod window;

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context as _, Result, ensure};
use clerestory::headless::GALLERY;
use clerestory_nystrom::BlockLowRank;
use clerestory_relight::synthetic::{Ranks, Recipe};
use clerestory_relight::{DeviceChoice, DisplayParams, Frame, Gpu, GpuRelighter, Precision};
use clerestory_transport::archive;
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::basis::{ColumnGroup, ColumnKind};
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::{PunctualLight, Scene};

use self::painter::Painter;
use self::window::Window;
use super::desk::Desk;
use super::fit::median;
use super::goal::Goal;

/// Lamps beside the panel.
const LAMPS: usize = 20;
/// Texels along each side of the panel.
const TEXELS: u32 = 32;
/// Largest rank of a block of the panel; they are spread evenly. Lamps have their number in every block.
const RANK: u32 = 9;
/// Most milliseconds that are asked for at a size: from an event to its picture, relit by so many cores at most; and of the window's
/// thread where a device of hardware relights.
const ASKED: (Film, f64) = (Film { width: 1024, height: 768 }, 33.0);
const ASKED_CORES: usize = 2;
const ASKED_OF_DEVICE: (Film, f64) = (Film { width: 1920, height: 1080 }, 4.0);
/// Events of one drag.
const EVENTS: [usize; 2] = [60, 400];
/// The same where a device relights, and where that is none of hardware, which takes much longer.
const DEVICE_EVENTS: [usize; 2] = [20, 150];
const SOFTWARE_EVENTS: [usize; 2] = [20, 50];

/// Drags a slider of one lamp and times the pictures.
///
/// # Errors
/// If the scene cannot be prepared, or a picture does not come.
pub fn write(desk: &Desk) -> Result<String> {
    let table = table(desk, "latency", DeviceChoice::Any)?;
    let [n_events, n_device_events, n_software_events] =
        [EVENTS, DEVICE_EVENTS, SOFTWARE_EVENTS].map(|[quick, full]| desk.choose(quick, full));
    Ok(format!(
        "## Latency\n\n\
         One slider dragged, once at each size and by each that relights, each event sent when the picture of the one before is there: {n_events} events on the CPU, {n_device_events} on a graphics device, {n_software_events} on a driver without hardware. {LAMPS} lamps and a\n\
         panel of {TEXELS} × {TEXELS} texels: blocks of rank {LAMPS} for the lamps, as they are kept apart, and of rank 0 to {RANK} for the panel, with random factors of seed {}, so that every block moves and none is left out for being unseen. Milliseconds on {} threads.\n\
         On the CPU from the event to the end of the frame that draws its picture, triangles of the interface made. On a device from the event until the\n\
         device has all commands of that frame, those of relighting and those that draw the window of 1440 × 900, into a picture instead of a screen. A driver without hardware\n\
         computes on the cores that we need, and in the call that hands it commands: OpenGL in the first, Vulkan in that of the window's picture, which waits until relighting is done.\n\
         The CPU time of the window's thread leaves out such waits, and what a driver computes on other threads.\n\
         Asked for: {} ms at {} × {} on {ASKED_CORES} cores, and {} ms of our own CPU time at {} × {} with a graphics device of hardware. {}\n\n{table}",
        Recipe::default().seed,
        rayon::current_num_threads(),
        ASKED.1,
        ASKED.0.width,
        ASKED.0.height,
        ASKED_OF_DEVICE.1,
        ASKED_OF_DEVICE.0.width,
        ASKED_OF_DEVICE.0.height,
        desk.load_words(),
    ))
}

/// The same on the CPU and on each device of a kind, as a table alone; each size is a part of a section.
///
/// # Errors
/// As [`write()`].
pub fn table(desk: &Desk, section: &str, choice: DeviceChoice) -> Result<String> {
    let mut rows = String::new();
    for film in [Film { width: 1024, height: 768 }, Film { width: 1920, height: 1080 }] {
        let part = format!("latency-{}x{}", film.width, film.height);
        rows += &desk.part::<String>(section, &part, || of_size(desk, film, choice))?;
    }
    Ok(format!("| size | what | median | 99th percentile |\n|---|---|---|---|\n{rows}"))
}

/// The rows of a size.
fn of_size(desk: &Desk, film: Film, choice: DeviceChoice) -> Result<String> {
    let size = format!("{}×{}", film.width, film.height);
    desk.say(&format!("dragging a slider at {size}"));
    let bake = synthetic_bake(film)?;
    let path = PathBuf::from(desk.file("latency.transport"));
    archive::write(&bake, &path)?;
    let drag = Window::open(&path, None)?.drag(desk.choose(EVENTS[0], EVENTS[1]))?;
    let asked_ms = (film == ASKED.0 && rayon::current_num_threads() <= ASKED_CORES).then_some(ASKED.1);
    let mut rows = format!("| {size} | event to picture, relit on the CPU | {} |\n", quantiles(drag.whole, asked_ms));
    rows += &format!("| {size} | of that, drawing one frame of the window | {} |\n", quantiles(drag.frames, None));
    for painter in Painter::all(choice) {
        desk.say(&format!("the same on {}", painter.name()));
        rows += &on_device(painter, &size, &path, &bake, desk)?;
    }
    Ok(rows)
}

/// The rows of a device: the whole way, what of it the window's thread works, and handing over relighting alone.
fn on_device(painter: Painter, size: &str, path: &Path, bake: &Bake, desk: &Desk) -> Result<String> {
    let (name, gpu) = (painter.name(), painter.gpu());
    let [quick, full] = if gpu.is_software() { SOFTWARE_EVENTS } else { DEVICE_EVENTS };
    let n_events = desk.choose(quick, full);
    let drag = Window::open(path, Some(painter))?.drag(n_events)?;
    let film = Film { width: bake.header.width, height: bake.header.height };
    let asked_ms = (film == ASKED_OF_DEVICE.0 && !gpu.is_software()).then_some(ASKED_OF_DEVICE.1);
    let work = if drag.work.is_empty() { "unknown |".into() } else { quantiles(drag.work, asked_ms) };
    let alone = quantiles(submissions(&gpu, bake, n_events)?, None);
    Ok(format!(
        "| {size} | event to submission, relit on {name} | {} |\n\
         | {size} | of that, CPU time of the window's thread | {work} |\n\
         | {size} | relighting alone, handed over | {alone} |\n",
        quantiles(drag.whole, None),
    ))
}

/// The lights of the gallery over blocks that no scene has.
fn synthetic_bake(film: Film) -> Result<Bake> {
    let panel = PanelRequest { node: "ceiling panel".into(), resolution: TEXELS };
    let scene = with_lamps(import::load_bytes("gallery", GALLERY)?.scene, &panel)?;
    let (scene, _) = PreparedScene::new(scene, &[panel])?;
    let camera = scene.scene.cameras.first().cloned().context("the gallery has no camera")?;
    let config = BakeConfig { spp: 1, tolerance_db: 10.0, ..BakeConfig::default() };
    let tiny = Film { width: 16, height: 16 };
    let scene = Arc::new(scene);
    let job = BakeJob { scene, camera, film: tiny, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
    let baked = job.run(|_| std::ops::ControlFlow::Continue(()))?.context("nobody stopped it")?;
    let mut header = (*baked.header).clone();
    (header.width, header.height) = (film.width, film.height);
    ensure!(
        header.basis.sources.len() == LAMPS + 1,
        "{} lights instead of {LAMPS} and a panel",
        header.basis.sources.len()
    );
    let groups = random_groups(&header.basis.groups, film, header.tile);
    Ok(Bake { header: Arc::new(header), groups, irradiance: Vec::new(), packed: None })
}

/// Random blocks of the ranks that bakes have: of lamps, which are kept apart, their number, and of all else some.
fn random_groups(groups: &[ColumnGroup], film: Film, tile: u32) -> Vec<BlockLowRank> {
    let random = |group: &ColumnGroup| {
        let n_cols = group.columns.len() as u32;
        let rank = if group.kind == ColumnKind::Luminaire { Ranks::Fixed(n_cols) } else { Ranks::Spread(RANK) };
        Recipe {
            width: film.width,
            height: film.height,
            tile,
            n_cols: vec![n_cols],
            rank,
            n_sparse: 0,
            is_positive: true,
            ..Recipe::default()
        }
        .frame()
        .groups
    };
    groups.iter().flat_map(random).collect()
}

/// The scene with more lamps like its first, so that it has as many as there should be beside a panel.
fn with_lamps(mut scene: Scene, panel: &PanelRequest) -> Result<Scene> {
    let n_there = PreparedScene::new(scene.clone(), std::slice::from_ref(panel))?.0.lighting.basis.sources.len() - 1;
    let lamp = scene.punctual.first().cloned().context("the gallery has no lamp")?;
    for nth in n_there..LAMPS {
        let mut node = scene.nodes[lamp.node as usize].clone();
        (node.index, node.name, node.lamp) = (10_000 + nth as u32, Some(format!("lamp {nth}")), None);
        scene.nodes.push(node);
        scene.punctual.push(PunctualLight { node: scene.nodes.len() as u32 - 1, ..lamp.clone() });
    }
    Ok(scene)
}

/// Seconds of the CPU until a device has its commands.
fn submissions(gpu: &Gpu, bake: &Bake, n_events: usize) -> Result<Vec<f64>> {
    let film = Film { width: bake.header.width, height: bake.header.height };
    let frame = Frame { width: film.width, height: film.height, groups: bake.groups.clone() };
    let mut relighter = GpuRelighter::with_precision(gpu, &frame, Precision::ByError)?;
    let mut rig = LightRig::default();
    let key = bake.header.basis.sources[0].key.clone();
    let mut secs = Vec::new();
    for turn in 0..n_events {
        rig.lights.entry(key.clone()).or_default().intensity = 1.0 + turn as f32 / n_events as f32;
        let start = Instant::now();
        relighter.relight_to_texture(&bake.header.coefficients(&rig), &DisplayParams::default())?;
        secs.push(start.elapsed().as_secs_f64());
        gpu.wait()?;
    }
    Ok(secs)
}

/// Median and 99th percentile in milliseconds, as two cells; each says whether it is what is asked for at most.
fn quantiles(mut secs: Vec<f64>, asked_ms: Option<f64>) -> String {
    secs.sort_by(f64::total_cmp);
    let cell = |secs: f64| {
        let ms = 1e3 * secs;
        let word = asked_ms.map_or(String::new(), |most| format!(", {}", Goal::Most(most).word(ms)));
        format!("{ms:.1}{word}")
    };
    let slow = secs[((secs.len() - 1) as f64 * 0.99).round() as usize];
    format!("{} | {}", cell(median(&secs).unwrap_or(f64::NAN)), cell(slow))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_of_lamps_have_the_rank_of_their_number_and_those_of_a_panel_some() {
        let groups = [(ColumnKind::Luminaire, 0..20), (ColumnKind::Panel, 20..1044)];
        let groups = groups.map(|(kind, columns)| ColumnGroup { kind, columns });
        let random = random_groups(&groups, Film { width: 64, height: 32 }, 16);
        let [lamps, panel] = &random[..] else { panic!("{} groups", random.len()) };
        assert!(lamps.n_cols == 20 && lamps.blocks.len() == 8);
        assert!(lamps.blocks.iter().all(|block| block.as_ref().is_some_and(|block| block.rank == 20)));
        assert!(panel.n_cols == 1024 && panel.blocks.iter().flatten().all(|block| block.rank <= RANK));
    }

    #[test]
    fn the_median_and_the_slowest_each_say_whether_they_are_what_is_asked_for() {
        let secs: Vec<f64> = (1..=100).map(|ms| 1e-3 * f64::from(ms)).collect();
        assert_eq!(quantiles(secs.clone(), Some(60.0)), "50.5, kept | 99.0, missed");
        assert_eq!(quantiles(secs, None), "50.5 | 99.0");
    }
}
