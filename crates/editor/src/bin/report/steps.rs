//! What a picture takes after a lamp has moved.

mod whole;

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clerestory::session::lamps::on_device;
use clerestory_relight::gpu::{DeviceChoice, Gpu, Lamplight, LitSample};
use clerestory_transport::bake::{Bake, BakeConfig, Indirect};
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::lamps::{FreeLamp, LampShape, PreparedLamps};
use clerestory_transport::patches::{DEFAULT_PATCHES, NARROW_ALPHA};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use glam::Vec3;

use self::whole::Window;
use super::desk::Desk;
use super::fit::{median, spread};
use super::goal::Goal;
use super::lamps::spent::bake;
use super::lamps::{cases, lamp, place, profile, sun};

/// The scene of our own.
const OWN: &str = "gallery";
/// Size of the picture whose steps are timed.
const STEP: Film = Film { width: 1024, height: 768 };
/// Steps that are timed, the median counts.
const STEPS: u32 = 7;
/// The same where the device is a driver without hardware, which takes minutes for what a card does in milliseconds.
const SOFTWARE_STEPS: u32 = 1;
/// Samples per pixel of the bake that is relit.
const SPP: u32 = 4;
/// Lamps of which one moves, in the scene of our own.
const CROWDS: [u32; 2] = [30, 100];
/// Where parallel light comes from, seen from the place that it is aimed at, m.
const SUNWARD: Vec3 = Vec3::new(-4.0, 3.0, 0.5);
/// Milliseconds that a whole picture may take, by the CPU and with a graphics device.
const GOALS_MS: [f64; 2] = [150.0, 16.0];

/// A table of scenes and lamps.
///
/// # Errors
/// If a scene cannot be prepared, or a device fails.
pub fn write(desk: &Desk) -> Result<String> {
    let gpu = Gpu::headless(DeviceChoice::Any).ok();
    let device = gpu
        .as_ref()
        .map_or("No graphics device was found.".into(), |gpu| format!("The device: {}.", gpu.description()));
    let table = table(desk, "steps", gpu.as_ref())?;
    Ok(format!(
        "## Steps of a moved lamp\n\n\
         *Whole* is what the window does from a lamp that has moved to the picture on the screen of 1024 × 768, its own drawing aside: one sample of the direct light of each pixel, the irradiance of\n\
         all {DEFAULT_PATCHES} patches, all columns of the bake (of {SPP} samples per pixel) relit, both summed and encoded, on the CPU or with the graphics device; a lamp that rests for 0.1 s is\n\
         refined as it is there. A *point, one of {}* (or of {}) moves while the others stand, all of which have had their first light; of it only *whole* is told. The *ies* lamp is a point with a measured distribution; *directional* light comes from 37° above the horizon and is turned, and is as dark as walls leave it. Goals: {} ms on a CPU of two threads, {} ms with a graphics device of hardware. The other columns are parts of it, each by itself; medians of {STEPS} steps ({SOFTWARE_STEPS} where the device is a driver without hardware), of the whole with least…greatest. The bake has seed 0. Shadow rays that nothing needs\n\
         are not cast. Where *whole* misses its goal, the columns behind it tell which part takes the time; what a device leaves to the CPU, and what it takes, [decision 0026](decisions/0026-the-device-lights-lamps-and-leaves-what-it-does-not-know.md) tells. `kernel` is the direct light on the graphics device by the device's own clock, `back` when the CPU can read it, `device` when the CPU has added what was left to it.\n\
         {device} {}\n\n{table}",
        CROWDS[0],
        CROWDS[1],
        GOALS_MS[0],
        GOALS_MS[1],
        desk.load_words(),
    ))
}

/// The table alone; each scene is a part of a section.
///
/// # Errors
/// As [`write()`].
pub fn table(desk: &Desk, section: &str, gpu: Option<&Gpu>) -> Result<String> {
    let mut text = "| scene | lamp | whole, CPU | whole, with the device | direct | shadow rays | rays a second | patches | kernel | back | device | left to the CPU |\n\
        |---|---|---|---|---|---|---|---|---|---|---|---|\n"
        .to_string();
    for case in cases(desk) {
        let kinds = kinds(desk.file("lamp.ies"))?;
        text += &desk.part::<String>(section, &format!("steps-{}", case.name), || {
            desk.say(&format!("steps in {}", case.name));
            let (scene, camera) = case.prepared()?;
            let scene = Arc::new(scene);
            let config =
                BakeConfig { spp: SPP, patches: DEFAULT_PATCHES, indirect: Indirect::Shared, ..BakeConfig::default() };
            let (bake, _) = bake(&scene, &camera, STEP, config)?;
            rows((case.name, kinds.as_slice()), (&scene, &camera), &bake, gpu)
        })?;
    }
    Ok(text)
}

/// Every kind of lamp; the distribution of one is written to a file.
fn kinds(file: String) -> Result<[LampShape; 7]> {
    Ok([
        LampShape::Point,
        LampShape::Spot { inner_rad: 0.3, outer_rad: 0.6 },
        LampShape::Rectangle { size_m: [0.6, 0.3] },
        LampShape::Disk { radius_m: 0.1 },
        LampShape::Sphere { radius_m: 0.1 },
        profile(file)?,
        sun::SUN,
    ])
}

/// A lamp at a place after so many steps of a centimeter; parallel light is turned, as it shines from nowhere in particular.
fn stepped(shape: &LampShape, place: Vec3, nth: u32) -> FreeLamp {
    let at = place + Vec3::X * 0.01 * nth as f32;
    if shape.is_parallel() { sun::parallel(shape.clone(), place + SUNWARD, at) } else { lamp(shape.clone(), at) }
}

/// Rows of a scene.
fn rows(
    (name, kinds): (&str, &[LampShape]),
    (scene, camera): (&Arc<PreparedScene>, &Camera),
    bake: &Bake,
    gpu: Option<&Gpu>,
) -> Result<String> {
    let config = VisibleConfig { narrow_alpha: NARROW_ALPHA, samples: 1, ..VisibleConfig::default() };
    let points = VisiblePoints::new(scene, camera, STEP, config, &|| false).context("nobody stopped it")?;
    let mut device = gpu.map(|gpu| Device::new(gpu, scene, &points)).transpose()?;
    let patches = bake.header.patches.as_ref().context("no patches")?;
    let goal_of_cpu = (rayon::current_num_threads() <= 2).then_some(GOALS_MS[0]);
    let (mut rows, at) = (String::new(), place(scene, camera, STEP, 0));
    let n_on_device = if gpu.is_some_and(Gpu::is_software) { SOFTWARE_STEPS } else { STEPS };
    for shape in kinds {
        let moved = |nth: u32| stepped(shape, at, nth);
        let whole = whole_cells(Window::new(bake, scene, camera, None)?, (&moved, STEPS), goal_of_cpu)?;
        let with_device = gpu.map_or(Ok("—".into()), |gpu| {
            let goal_ms = (!gpu.is_software()).then_some(GOALS_MS[1]);
            whole_cells(Window::new(bake, scene, camera, Some(gpu))?, (&moved, n_on_device), goal_ms)
        })?;
        let (mut direct_steps, mut patch_ms, mut device_steps) = (vec![], vec![], vec![]);
        for nth in 0..STEPS {
            let lamps = PreparedLamps::new(&[moved(nth)], None)?.0;
            let before = points.n_rays();
            let direct_ms = timed_ms(|| points.direct(scene, &lamps, 0, &|| false));
            direct_steps.push([direct_ms, (points.n_rays() - before) as f64]);
            patch_ms.push(timed_ms(|| lamps.light_on_patches(scene, patches, bake.header.config.bounces)));
            if let Some(device) = device.as_mut().filter(|_| nth < n_on_device) {
                device_steps.push(device.step(scene, &points, &lamps)?);
            }
        }
        let (direct, of_patches) = (direct_cells(&direct_steps), median(&patch_ms).unwrap_or(f64::NAN));
        let on_device = device_cells(&device_steps);
        rows += &format!(
            "| {name} | {} | {whole} | {with_device} | {direct} | {of_patches:.0} ms | {on_device} |\n",
            shape.name(),
        );
    }
    if name == OWN {
        for n_lamps in CROWDS {
            let mut window = Window::new(bake, scene, camera, None)?;
            window.stand(standing(n_lamps - 1, |nth| place(scene, camera, STEP, nth)));
            let moved = |nth: u32| stepped(&LampShape::Point, at, nth);
            let whole = whole_cells(window, (&moved, STEPS), goal_of_cpu)?;
            rows += &format!("| {name} | point, one of {n_lamps} | {whole} |{}\n", " — |".repeat(9));
        }
    }
    Ok(rows)
}

/// So many point lamps at places of their own, numbered from 1.
fn standing(n_lamps: u32, place: impl Fn(u32) -> Vec3) -> Vec<FreeLamp> {
    let standing = |nth: u32| FreeLamp { key: format!("standing {nth}"), ..lamp(LampShape::Point, place(nth)) };
    (1..=n_lamps).map(standing).collect()
}

fn timed_ms<T>(work: impl FnOnce() -> T) -> f64 {
    let begun = Instant::now();
    std::hint::black_box(work());
    ms_since(begun)
}

fn ms_since(begun: Instant) -> f64 {
    begun.elapsed().as_secs_f64() * 1e3
}

/// The median of the steps of a lamp in the window, and whether it keeps its goal, if it has one.
fn whole_cells(
    mut window: Window,
    (moved, n_steps): (&dyn Fn(u32) -> FreeLamp, u32),
    goal_ms: Option<f64>,
) -> Result<String> {
    // The first step looks at the scene and takes the bake over.
    window.step(moved(STEPS))?;
    let ms = (0..n_steps).map(|nth| Ok(1e3 * window.step(moved(nth))?)).collect::<Result<Vec<f64>>>()?;
    let [least, middle, most] = spread(&ms);
    let words = format!("{middle:.0} ms ({least:.0}…{most:.0})");
    Ok(goal_ms.map_or(words.clone(), |goal| format!("{words}, {}", Goal::Most(goal).word(middle))))
}

/// What pixels see, on the graphics device.
struct Device {
    lamplight: Lamplight,
    sample: LitSample,
}

impl Device {
    fn new(gpu: &Gpu, scene: &PreparedScene, points: &VisiblePoints) -> Result<Device> {
        let lamplight = on_device(gpu, scene)?;
        let seen = points.words(scene, 0);
        let sample = lamplight.sample([STEP.width, STEP.height], &seen.starts, &seen.points)?;
        Ok(Device { lamplight, sample })
    }

    /// A whole picture.
    fn step(&mut self, scene: &PreparedScene, points: &VisiblePoints, lamps: &PreparedLamps) -> Result<DeviceStep> {
        let begun = Instant::now();
        let words = lamps.words(scene).context("the device knows this lamp")?;
        let lamp = (&words.lamp, words.distribution.as_slice());
        let look = |found: &[[f32; 4]]| {
            let seen_ms = ms_since(begun);
            std::hint::black_box(points.completed(scene, lamps, 0, found, &|| false));
            (seen_ms, ms_since(begun), found.iter().filter(|rgb| rgb[3] != 0.0).count())
        };
        let (seen_ms, whole_ms, n_left) = self.lamplight.light(&self.sample, lamp, &points.shifts(0), look)?;
        // What a device without hardware notes is when it was told, not when it worked.
        let is_told = !self.lamplight.gpu().is_software();
        let kernel_ms = self.lamplight.kernel_secs()?.filter(|_| is_told).map(|secs| 1e3 * secs);
        Ok(DeviceStep { kernel_ms, seen_ms, whole_ms, n_left })
    }
}

/// What a step takes on the device, until what is told of, ms.
struct DeviceStep {
    /// The kernel alone, by the device's clock.
    kernel_ms: Option<f64>,
    /// Its light can be read.
    seen_ms: f64,
    /// The CPU has done its part.
    whole_ms: f64,
    /// Pixels that were left to the CPU.
    n_left: usize,
}

/// Medians of the direct light of steps, given the ms and the shadow rays of each: the time, the rays, and millions of them a second.
fn direct_cells(steps: &[[f64; 2]]) -> String {
    let middle = |of: fn(&[f64; 2]) -> f64| median(&steps.iter().map(of).collect::<Vec<_>>()).unwrap_or(f64::NAN);
    let [ms, n_rays, rate] = [middle(|step| step[0]), middle(|step| step[1]), middle(|step| step[1] / step[0] / 1e3)];
    format!("{ms:.0} ms | {n_rays:.0} | {rate:.1} M")
}

/// Medians of the steps on a device, if there were any.
fn device_cells(steps: &[DeviceStep]) -> String {
    let shares = steps.iter().map(|step| 100.0 * step.n_left as f64 / STEP.n_pixels() as f64).collect::<Vec<_>>();
    let Some(left) = median(&shares) else { return "— | — | — | —".into() };
    let middle = |of: &dyn Fn(&DeviceStep) -> Option<f64>| {
        let ms: Option<Vec<f64>> = steps.iter().map(of).collect();
        ms.and_then(|ms| median(&ms)).map_or("—".to_string(), |ms| format!("{ms:.1} ms"))
    };
    format!(
        "{} | {} | {} | {left:.1} %",
        middle(&|step| step.kernel_ms),
        middle(&|step| Some(step.seen_ms)),
        middle(&|step| Some(step.whole_ms)),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_lamp_shines_and_is_another_one_after_a_step() {
        let folder = tempfile::tempdir().unwrap();
        let kinds = kinds(folder.path().join("lamp.ies").display().to_string()).unwrap();
        for (nth, shape) in kinds.iter().enumerate() {
            assert!(kinds[..nth].iter().all(|other| other.name() != shape.name()));
            let [before, after] = [0, 1].map(|step| stepped(shape, Vec3::Y, step));
            if shape.is_parallel() {
                assert_ne!(before.aim - before.position, after.aim - after.position, "parallel light is turned");
            } else {
                assert!((after.position.distance(before.position) - 0.01).abs() < 1e-6, "{}", shape.name());
            }
            let (lamps, remarks) = PreparedLamps::new(&[before], None).unwrap();
            assert!(!lamps.is_empty() && remarks.is_empty(), "{}: {remarks:?}", shape.name());
        }
    }

    #[test]
    fn parts_of_steps_are_told_by_the_medians_of_each() {
        assert_eq!(direct_cells(&[[10.0, 1e4], [20.0, 4e4], [40.0, 2e4]]), "20 ms | 20000 | 1.0 M");
        let step = |n_left: usize| DeviceStep { kernel_ms: None, seen_ms: 1.0, whole_ms: 2.0, n_left };
        let steps = [STEP.n_pixels() / 2, STEP.n_pixels() / 4, 0].map(step);
        assert_eq!(device_cells(&steps), "— | 1.0 ms | 2.0 ms | 25.0 %");
        assert_eq!(device_cells(&[]), "— | — | — | —");
    }

    #[test]
    fn lamps_that_stand_have_places_and_names_of_their_own() {
        let lamps = standing(3, |nth| Vec3::X * nth as f32);
        assert_eq!(lamps.iter().map(|lamp| lamp.position.x).collect::<Vec<_>>(), [1.0, 2.0, 3.0]);
        assert_eq!(
            lamps.iter().map(|lamp| lamp.key.as_str()).collect::<Vec<_>>(),
            ["standing 1", "standing 2", "standing 3"]
        );
    }
}
