//! What a picture takes after a lamp has moved.

use std::time::Instant;

use anyhow::{Context, Result};
use clerestory_relight::gpu::{DeviceChoice, Gpu, Lamplight, LitSample, TreeWords};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::{LampShape, PreparedLamps};
use clerestory_transport::patches::{DEFAULT_PATCHES, NARROW_ALPHA};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use glam::Vec3;

use super::desk::Desk;
use super::lamps::{bake, cases, lamp, place, prepared};

/// Size of the picture whose steps are timed.
const STEP: Film = Film { width: 1024, height: 768 };
/// Steps that are timed, the median counts.
const STEPS: u32 = 7;
/// Width of the bake whose patches are lit.
const SMALL: u32 = 32;

/// A table of scenes and lamps.
///
/// # Errors
/// If a scene cannot be prepared, or a device fails.
pub fn write(desk: &Desk) -> Result<String> {
    let gpu = Gpu::headless(DeviceChoice::Any).ok();
    let device = gpu
        .as_ref()
        .map_or("No graphics device was found.".into(), |gpu| format!("The device: {}.", gpu.description()));
    let table = table(desk, gpu.as_ref())?;
    Ok(format!(
        "## Steps of a moved lamp\n\n\
         A step is one whole picture of 1024 × 768 after a lamp has moved: one sample of each pixel, and the irradiance of\n\
         all patches; medians. Shadow rays that nothing needs are not cast. `device` is the same direct light by a kernel on the graphics\n\
         device, the way back to memory and what it leaves to the CPU included; none where light comes through solid panes.\n\
         {device} {}\n\n{table}",
        desk.load_words(),
    ))
}

/// The table alone.
///
/// # Errors
/// As [`write()`].
pub fn table(desk: &Desk, gpu: Option<&Gpu>) -> Result<String> {
    let mut text = "| scene | lamp | direct | shadow rays | rays a second | patches | device | left to the CPU |\n\
        |---|---|---|---|---|---|---|---|\n"
        .to_string();
    for case in cases(desk) {
        desk.say(&format!("steps in {}", case.name));
        let (scene, camera) = prepared(&case.path, case.has_sky)?;
        let scene = std::sync::Arc::new(scene);
        let (bake, _) = bake(&scene, &camera, Film::of_width(SMALL, &camera), 1, DEFAULT_PATCHES)?;
        let patches = bake.header.patches.as_ref().context("no patches")?;
        text += &rows(case.name, &scene, &camera, gpu, &|lamps| {
            std::hint::black_box(lamps.light_on_patches(&scene, patches));
        })?;
    }
    Ok(text)
}

/// Rows of a scene.
fn rows(
    name: &str,
    scene: &PreparedScene,
    camera: &Camera,
    gpu: Option<&Gpu>,
    patches: &dyn Fn(&PreparedLamps),
) -> Result<String> {
    let points = VisiblePoints::new(
        scene,
        camera,
        STEP,
        VisibleConfig { narrow_alpha: NARROW_ALPHA, samples: 1, ..VisibleConfig::default() },
        &|| false,
    );
    let points = points.context("nobody stopped it")?;
    let device = gpu.map(|gpu| Device::new(gpu, scene, &points)).transpose()?.flatten();
    let mut rows = String::new();
    for shape in [LampShape::Point, LampShape::Rectangle { size_m: [0.6, 0.3] }, LampShape::Sphere { radius_m: 0.1 }] {
        let (mut direct_ms, mut patch_ms, mut device_ms, mut n_rays, mut n_left) = (vec![], vec![], vec![], 0, 0);
        for nth in 0..STEPS {
            let at = place(scene, camera, STEP, 0) + Vec3::X * 0.01 * nth as f32;
            let lamps = PreparedLamps::new(&[lamp(shape.clone(), at)], None)?.0;
            let (before, begun) = (points.n_rays(), Instant::now());
            std::hint::black_box(points.direct(scene, &lamps, 0, &|| false));
            direct_ms.push(begun.elapsed().as_secs_f64() * 1e3);
            n_rays = points.n_rays() - before;
            let begun = Instant::now();
            patches(&lamps);
            patch_ms.push(begun.elapsed().as_secs_f64() * 1e3);
            if let Some(device) = &device {
                let begun = Instant::now();
                n_left = device.step(scene, &points, &lamps)?;
                device_ms.push(begun.elapsed().as_secs_f64() * 1e3);
            }
        }
        let median = |times: &mut Vec<f64>| {
            times.sort_by(f64::total_cmp);
            times[times.len() / 2]
        };
        let (direct, of_patches) = (median(&mut direct_ms), median(&mut patch_ms));
        let on_device = match device_ms.is_empty() {
            true => "— | —".to_string(),
            false => {
                let share = n_left as f64 / STEP.n_pixels() as f64;
                format!("{:.0} ms | {:.1} %", median(&mut device_ms), 100.0 * share)
            }
        };
        rows += &format!(
            "| {name} | {} | {direct:.0} ms | {n_rays} | {:.1} M | {of_patches:.0} ms | {on_device} |\n",
            shape.name(),
            n_rays as f64 / direct / 1e3,
        );
    }
    Ok(rows)
}

/// What pixels see, on the graphics device.
struct Device {
    lamplight: Lamplight,
    sample: LitSample,
}

impl Device {
    /// `None` where only the CPU knows how light travels.
    fn new(gpu: &Gpu, scene: &PreparedScene, points: &VisiblePoints) -> Result<Option<Device>> {
        let Some(words) = scene.tree_words() else { return Ok(None) };
        let coats = scene.coat_table();
        let tree = TreeWords { nodes: &words.nodes, blocks: &words.blocks, sheer: words.second, coats: &coats };
        let lamplight = Lamplight::new(gpu, tree)?;
        let seen = points.words(scene, 0);
        let sample = lamplight.sample([STEP.width, STEP.height], &seen.starts, &seen.points)?;
        Ok(Some(Device { lamplight, sample }))
    }

    /// A whole picture; returns the pixels that were left to the CPU.
    fn step(&self, scene: &PreparedScene, points: &VisiblePoints, lamps: &PreparedLamps) -> Result<usize> {
        let lamp = lamps.words(scene).context("the device knows this lamp")?;
        let completed = |found: &[[f32; 4]]| {
            std::hint::black_box(points.completed(scene, lamps, 0, found, &|| false));
            found.iter().filter(|rgb| rgb[3] != 0.0).count()
        };
        Ok(self.lamplight.light(&self.sample, &lamp, &points.shifts(0), completed)?)
    }
}
