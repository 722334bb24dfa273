//! Lamps that no bake knew: what patches and live light make of them, against traced pictures of the same lamps.

use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result};
use clerestory::look::sky;
use clerestory_transport::archive;
use clerestory_transport::bake::{Bake, BakeConfig, BakeJob, Passes};
use clerestory_transport::bvh::Ray;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::import;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit, PreparedLamps};
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::patches::DEFAULT_PATCHES;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sampler::{Sampler, uniform_hash};
use clerestory_transport::sky::{SkyForm, SkyLight};
use clerestory_transport::trace::TraceConfig;
use clerestory_transport::visible::{VisibleConfig, VisiblePoints};
use glam::{Vec2, Vec3};

use super::desk::Desk;
use super::rendered::rendered;

/// Strength of the lamp, lm.
const LUMEN: f32 = 1500.0;
/// Passes of the live light that is held against a reference.
const PASSES: u32 = 64;
/// Noise of a reference of the indirect light, beyond which its place says nothing.
const MOST_NOISE: f64 = 0.5;

/// A scene in which a lamp is moved.
pub(super) struct Case {
    pub name: &'static str,
    pub path: PathBuf,
    pub has_sky: bool,
}

/// What was measured at the places of a lamp.
#[derive(Default)]
struct Errors {
    /// Places whose indirect light drowns in the noise of its references.
    n_drowned: u32,
    /// Relative L2 of the indirect light, and of the reference's own noise, of each place.
    indirect: Vec<[f64; 2]>,
    /// Share of the indirect light that is found, of each place.
    energy: Vec<f64>,
    /// PSNR of the whole picture and of the reference's noise, of each place, dB.
    psnr: Vec<[f64; 2]>,
}

/// A table of scenes.
pub fn write(desk: &Desk) -> Result<String> {
    let mut table = String::new();
    for case in cases(desk) {
        desk.say(&format!("lamps in {}", case.name));
        let measured = || measure(desk, &case).with_context(|| format!("cannot move lamps in {}", case.name));
        let rows: String = desk.part("lamps", case.name, measured)?;
        table += &rows;
    }
    Ok(format!(
        "## Lamps that were added\n\n\
        A point lamp of 1500 lm at places that no bake knew. The picture is the baked light of the file, plus the lamp's \
        direct light at what is seen and at what narrow lobes show there, plus what the patches make of its irradiance. It is held \
        against two independent traced pictures of the same look, direct light taken off by two independent live pictures, so that \
        their noise does not count as error; how large the noise of their mean is stands beside it. Places whose indirect light drowns in \
        that noise (more than half of it) are counted and left out of its columns. Medians (and the worst) over the places. Energy is the sum of the indirect light over that \
        of the reference. The peak of PSNR is the 99.5 percentile of the whole. Bytes of patches are those of their columns' blocks, and \
        of their table. Seconds by the clock, one bake each. {}\n\n\
        | scene | places | drowned | indirect L2 | noise | energy, least to most | whole PSNR | noise | patches | columns | bytes without \
        | of patches | bake without | of patches |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|\n{table}",
        desk.load_words(),
    ))
}

pub(super) fn cases(desk: &Desk) -> Vec<Case> {
    let own = Some(desk.root.join("assets/scenes/gallery.glb"));
    let shared = |name: &str| desk.shared(&format!("scenes/{name}.glb"));
    let all = [
        ("gallery", own, false),
        ("conference", shared("conference"), false),
        ("staircase2", shared("bitterli-staircase2"), false),
        ("living-room", shared("bitterli-living-room"), true),
    ];
    let n_cases = desk.choose(1, all.len());
    let found = all.into_iter().take(n_cases);
    let case = |(name, path, has_sky): (&'static str, Option<PathBuf>, bool)| {
        Some(Case { name, path: path.filter(|path| path.exists())?, has_sky })
    };
    found.filter_map(case).collect()
}

pub(super) fn prepared(path: &Path, has_sky: bool) -> Result<(PreparedScene, Camera)> {
    let imported = import::load(path)?;
    let camera = imported.scene.cameras.first().context("no camera")?.clone();
    let sky = if has_sky { Some(SkyRequest { light: uniform_sky()?, form: SkyForm::Patches(1) }) } else { None };
    Ok((PreparedScene::with_sky(imported.scene, &[], sky.as_ref())?.0, camera))
}

fn uniform_sky() -> Result<SkyLight> {
    let mut setting = sky::typed("uniform").map_err(anyhow::Error::msg)?;
    sky::load(&mut setting, Path::new(""))?;
    setting.light(None).context("no sky")
}

/// Lamps of a scene, the light that belongs to it, and two traced pictures of each.
struct Traced {
    lamps: Vec<PreparedLamps>,
    of_lamps: Vec<[Vec<f32>; 2]>,
    of_file: [Vec<f32>; 2],
}

impl Traced {
    fn find(desk: &Desk, case: &Case, (scene, camera, film): (&PreparedScene, &Camera, Film)) -> Result<Traced> {
        let (n_places, spp) = desk.choose((3, 256), (10, 2048));
        let coefficients = scene.lighting.basis.project(&LightRig::default());
        let of_file = traced(scene, film, &coefficients, spp, [1, 2])?;
        let (mut lamps, mut of_lamps) = (Vec::new(), Vec::new());
        for nth in 0..n_places {
            let own = point_lamp(place(scene, camera, film, nth))?;
            let (mut lit, _) = prepared(&case.path, false)?;
            own.install(&mut lit)?;
            let mut coefficients = vec![[0.0; 3]; lit.lighting.basis.n_cols()];
            let last = lit.lighting.basis.sources.last().context("no lamp")?;
            coefficients[last.columns.start as usize] = (last.color * last.strength).to_array();
            of_lamps.push(traced(&lit, film, &coefficients, spp, [3, 4])?);
            lamps.push(own);
        }
        Ok(Traced { lamps, of_lamps, of_file })
    }
}

fn measure(desk: &Desk, case: &Case) -> Result<String> {
    let (scene, camera) = prepared(&case.path, case.has_sky)?;
    let scene = Arc::new(scene);
    let film = Film::of_width(64, &camera);
    let bake_spp = desk.choose(64, 256);
    let traced = Traced::find(desk, case, (&scene, &camera, film))?;
    let (plain, plain_secs) = bake(&scene, &camera, film, bake_spp, 0)?;
    let mut rows = String::new();
    for n_patches in desk.choose(&[DEFAULT_PATCHES][..], &[1024, 2048, DEFAULT_PATCHES]) {
        let (bake, secs) = bake(&scene, &camera, film, bake_spp, *n_patches)?;
        let patches = bake.header.patches.as_ref().context("no patches")?;
        let own = relit(&bake, &bake.header.coefficients(&LightRig::default()));
        let mut errors = Errors::default();
        for (lamps, references) in traced.lamps.iter().zip(&traced.of_lamps) {
            let mut of_bake: Vec<Vec<[f32; 3]>> =
                bake.header.basis.groups.iter().map(|group| vec![[0.0; 3]; group.columns.len()]).collect();
            if let Some(of_patches) = of_bake.last_mut() {
                *of_patches = lamps.light_on_patches(&scene, patches);
            }
            let [first, second] = [1, 2].map(|seed| direct(&scene, &camera, film, lamps, (seed, 0.0)));
            let shown = direct(&scene, &camera, film, lamps, (1, patches.narrow_alpha()))?;
            let directs = [first?, second?];
            let mut indirect = relit(&bake, &of_bake);
            let shown = shown.iter().zip(&directs[0]).map(|(all, direct)| all - direct);
            indirect.iter_mut().zip(shown).for_each(|(sum, shown)| *sum += shown);
            errors.add(&indirect, &directs, &own, references, &traced.of_file);
        }
        let [file_mib, plain_mib] = [file_mib(desk, &bake)?, file_mib(desk, &plain)?];
        rows += &format!(
            "| {} | {} | {} | {} | {} | {:.2} MiB | {:.2} MiB | {plain_secs:.1} s | {:.1} s |\n",
            case.name,
            traced.lamps.len(),
            errors.words(),
            patches.n_patches(),
            patches.n_columns(),
            plain_mib,
            file_mib - plain_mib,
            secs - plain_secs,
        );
        desk.say(&format!("{} with {} patches: {:.3?}", case.name, patches.n_patches(), errors.indirect));
    }
    Ok(rows)
}

/// Size of a bake as a file, MiB.
fn file_mib(desk: &Desk, bake: &Bake) -> Result<f64> {
    let path = desk.file("lamps.transport");
    archive::write(bake, Path::new(&path))?;
    Ok(std::fs::metadata(path)?.len() as f64 / f64::from(1 << 20))
}

pub(super) fn bake(
    scene: &Arc<PreparedScene>,
    camera: &Camera,
    film: Film,
    spp: u32,
    patches: u32,
) -> Result<(Bake, f64)> {
    let config = BakeConfig { spp, patches, ..BakeConfig::default() };
    let (passes, irradiance) = (Passes::FinalOnly, Vec::new());
    let job = BakeJob { scene: scene.clone(), camera: camera.clone(), film, config, passes, irradiance };
    let begun = Instant::now();
    let bake = job.run(|_| ControlFlow::Continue(()))?.context("nobody stopped it")?;
    Ok((bake, begun.elapsed().as_secs_f64()))
}

/// Two path-traced pictures with seeds of their own.
fn traced(scene: &PreparedScene, film: Film, light: &[[f32; 3]], spp: u32, seeds: [u64; 2]) -> Result<[Vec<f32>; 2]> {
    let traced = |seed| rendered(scene, film, light, &TraceConfig { spp, bounces: None, seed });
    let [a, b] = seeds.map(|seed| traced(seed).map(|picture| picture.pixels.into_flattened()));
    Ok([a?, b?])
}

fn direct(
    scene: &PreparedScene,
    camera: &Camera,
    film: Film,
    lamps: &PreparedLamps,
    (seed, narrow_alpha): (u64, f32),
) -> Result<Vec<f32>> {
    let config = VisibleConfig { samples: PASSES, seed, narrow_alpha, ..VisibleConfig::default() };
    let points = VisiblePoints::new(scene, camera, film, config, &|| false);
    let points = points.context("nobody stopped it")?;
    let mut sum = vec![0.0; 3 * film.n_pixels()];
    for pass in 0..PASSES {
        let picture = points.direct(scene, lamps, pass, &|| false).context("nobody stopped it")?;
        sum.iter_mut().zip(picture.iter().flatten()).for_each(|(sum, value)| *sum += value / PASSES as f32);
    }
    Ok(sum)
}

/// The picture of a bake under coefficients.
fn relit(bake: &Bake, coefficients: &[Vec<[f32; 3]>]) -> Vec<f32> {
    let mut picture = vec![0.0; 3 * (bake.header.width * bake.header.height) as usize];
    for (group, coefficients) in bake.groups.iter().zip(coefficients) {
        for channel in 0..3 {
            let light: Vec<f32> = coefficients.iter().map(|rgb| rgb[channel]).collect();
            let rows = group.apply(&light);
            picture.iter_mut().zip(rows).skip(channel).step_by(3).for_each(|(sum, value)| *sum += value);
        }
    }
    picture
}

impl Errors {
    /// The lamp's own light (`indirect`, two of `directs` and of references) and that of the file (`own`, two references).
    fn add(
        &mut self,
        indirect: &[f32],
        directs: &[Vec<f32>; 2],
        own: &[f32],
        references: &[Vec<f32>; 2],
        own_references: &[Vec<f32>; 2],
    ) {
        let [mut off, mut light, mut noise, mut whole_off, mut whole_noise] = [0.0f64; 5];
        let [mut found, mut there] = [0.0f64; 2];
        let mut whole: Vec<f32> = Vec::with_capacity(own.len());
        for at in 0..own.len() {
            let [a, b] = [0, 1].map(|half| f64::from(references[half][at] - directs[half][at]));
            let x = f64::from(indirect[at]);
            off += (x - a) * (x - b);
            light += a * b;
            (found, there) = (found + x, there + 0.5 * (a + b));
            noise += 0.25 * (a - b).powi(2);
            let [own_a, own_b] = [0, 1].map(|half| f64::from(own_references[half][at]));
            let (picture, a, b) = (x + f64::from(own[at]), a + own_a, b + own_b);
            whole_off += (picture - a) * (picture - b);
            whole_noise += 0.25 * (a - b).powi(2);
            whole.push(0.5 * (a + b) as f32 + directs[0][at]);
        }
        whole.sort_by(f32::total_cmp);
        let peak = f64::from(whole[whole.len() * 995 / 1000]);
        let db = |sum: f64| 10.0 * (peak * peak * whole.len() as f64 / sum.max(1e-12 * peak * peak)).log10();
        self.psnr.push([db(whole_off), db(whole_noise)]);
        if noise > MOST_NOISE * MOST_NOISE * light {
            self.n_drowned += 1;
            return;
        }
        self.indirect.push([off.max(0.0), noise].map(|sum| (sum / light).sqrt()));
        self.energy.push(found / there);
    }

    fn words(&self) -> String {
        let sorted = |values: &[[f64; 2]], which: usize| {
            let mut values: Vec<f64> = values.iter().map(|value| value[which]).collect();
            values.sort_by(f64::total_cmp);
            values
        };
        let percents = |which: usize| {
            let values = sorted(&self.indirect, which);
            let Some(worst) = values.last() else { return "not measured".to_string() };
            format!("{:.1} % ({:.1} %)", 100.0 * values[values.len() / 2], 100.0 * worst)
        };
        let decibels = |which: usize| {
            let values = sorted(&self.psnr, which);
            values
                .first()
                .map(|worst| format!("{:.1} dB ({worst:.1} dB)", values[values.len() / 2]))
                .unwrap_or_default()
        };
        let lowest = self.energy.iter().copied().fold(f64::INFINITY, f64::min);
        let highest = self.energy.iter().copied().fold(0.0, f64::max);
        format!(
            "{} | {} | {} | {lowest:.3} to {highest:.3} | {} | {}",
            self.n_drowned,
            percents(0),
            percents(1),
            decibels(0),
            decibels(1),
        )
    }
}

pub(super) fn lamp(shape: LampShape, position: Vec3) -> FreeLamp {
    let (aim, unit, setting) = (position - Vec3::Y, LampUnit::Lumen, LightSetting::default());
    FreeLamp {
        key: "a lamp of the report".into(),
        shape,
        position,
        aim,
        strength: LUMEN,
        unit,
        setting,
        replaces: None,
    }
}

fn point_lamp(position: Vec3) -> Result<PreparedLamps> {
    Ok(PreparedLamps::new(&[lamp(LampShape::Point, position)], None)?.0)
}

/// A place in the open space before the camera: between a surface that it sees and another one that is seen from there.
pub(super) fn place(scene: &PreparedScene, camera: &Camera, film: Film, nth: u32) -> Vec3 {
    let u = |key: u64| uniform_hash(0x1A_4F00 + u64::from(nth) * 16 + key);
    let film_px = Vec2::new(u(0) * film.width as f32, u(1) * film.height as f32);
    let ray = |origin, direction| Ray { origin, direction, t_min: 0.0, t_max: f32::INFINITY };
    let mut sampler = Sampler::new(1, 1, 1);
    let first = ray(camera.position(), camera.direction(film, film_px));
    let Some(hit) = scene.closest(&first, &mut sampler) else { return camera.position() };
    let normal = if hit.normal.dot(first.direction) > 0.0 { -hit.normal } else { hit.normal };
    let z = 1.0 - 2.0 * u(3);
    let (sin, cos) = (std::f32::consts::TAU * u(4)).sin_cos();
    let aside = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z);
    let next = ray(hit.origin(normal), (aside + normal).normalize_or(normal));
    let free = scene.closest(&next, &mut sampler).map_or(1.0, |hit| hit.t);
    next.origin + next.direction * free * (0.1 + 0.8 * u(2))
}
