//! How near the indirect light of a lamp comes that no bake knew, by way of patches, to a traced picture of it.
//!
//! `cargo run --release -p clerestory-transport --example moved_lamps -- SCENE WIDTH N_LAMPS SPP_REFERENCE BAKE_SPP N_PATCHES…`
#![expect(clippy::print_stdout, reason = "an example speaks to whoever runs it")]

use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Arc;
use std::time::Instant;

use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
use clerestory_transport::bvh::Ray;
use clerestory_transport::camera::{Camera, Film};
use clerestory_transport::import;
use clerestory_transport::patches::Patches;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sampler::{Sampler, uniform_hash};
use clerestory_transport::scene::{PunctualKind, PunctualLight, Scene};
use clerestory_transport::trace::{TraceConfig, trace};
use glam::{Vec2, Vec3};

type Failure = Box<dyn std::error::Error>;

fn main() -> Result<(), Failure> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [path, numbers @ ..] = arguments.as_slice() else { return Err("name a scene".into()) };
    let numbers: Vec<u32> = numbers.iter().map(|n| n.parse()).collect::<Result<_, _>>()?;
    let [width, n_lamps, spp, bake_spp, patches @ ..] = numbers.as_slice() else { return Err("give numbers".into()) };
    let imported = import::load(Path::new(path))?;
    let camera = imported.scene.cameras[0].clone();
    let film = Film::of_width(*width, &camera);
    let scene = Arc::new(PreparedScene::new(imported.scene.clone(), &[])?.0);
    let lamps: Vec<Vec3> = (0..*n_lamps).map(|nth| place(&scene, &camera, film, nth)).collect();
    let references: Vec<Reference> = lamps
        .iter()
        .map(|&lamp| Reference::trace(&imported.scene, &camera, film, lamp, *spp))
        .collect::<Result<_, _>>()?;
    println!("{path}: {}x{}, {n_lamps} lamps, references of 2 x {spp} samples", film.width, film.height);
    let plain = bake(&scene, &camera, film, *bake_spp, 0)?;
    println!("without patches: {:.1} s, {} bytes", plain.secs, plain.bytes);
    for &n in patches {
        let baked = bake(&scene, &camera, film, *bake_spp, n)?;
        let Some(patches) = &baked.bake.header.patches else { return Err("no patches".into()) };
        let group = baked.bake.groups.last().ok_or("no groups")?;
        println!(
            "{n} patches: {} columns, held out {:.4}, {:.1} s, {} bytes, rank {:.1}, samples {:.1}",
            patches.n_columns(),
            patches.held_out_error(),
            baked.secs,
            baked.bytes,
            group.mean_rank(),
            group.blocks.iter().flatten().map(|b| f64::from(b.n_samples)).sum::<f64>() / group.blocks.len() as f64,
        );
        let mut sums = [0.0; 2];
        for (lamp, reference) in lamps.iter().zip(&references) {
            let begun = Instant::now();
            let coefficients = light_of(&scene, patches, *lamp);
            let ms = begun.elapsed().as_secs_f64() * 1e3;
            let channels = [0, 1, 2].map(|c| group.apply(&coefficients.iter().map(|rgb| rgb[c]).collect::<Vec<_>>()));
            let found: Vec<f32> = (0..3 * film.n_pixels()).map(|row| channels[row % 3][row]).collect();
            let [error, psnr, energy] = reference.compare(&found);
            println!("  {lamp:.2}: L2 {:.2} %, PSNR {psnr:.1} dB, energy {energy:.3}, {ms:.0} ms", 100.0 * error);
            sums[0] += error;
            sums[1] += psnr;
        }
        println!(
            "  mean: L2 {:.2} %, PSNR {:.1} dB",
            100.0 * sums[0] / lamps.len() as f64,
            sums[1] / lamps.len() as f64
        );
    }
    Ok(())
}

struct Baked {
    bake: clerestory_transport::bake::Bake,
    secs: f64,
    bytes: usize,
}

fn bake(scene: &Arc<PreparedScene>, camera: &Camera, film: Film, spp: u32, patches: u32) -> Result<Baked, Failure> {
    let config = BakeConfig { spp, patches, ..BakeConfig::default() };
    let (passes, irradiance) = (Passes::FinalOnly, Vec::new());
    let job = BakeJob { scene: scene.clone(), camera: camera.clone(), film, config, passes, irradiance };
    let begun = cpu_secs();
    let bake = job.run(|_| ControlFlow::Continue(()))?.ok_or("stopped")?;
    let secs = cpu_secs() - begun;
    let bytes = bake.packed.as_ref().map_or(0, |m| m[0].iter().map(|g| g.n_bytes()).sum());
    Ok(Baked { bake, secs, bytes })
}

/// Processor time of this process so far, where Linux tells it: other programs do not count.
fn cpu_secs() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let ticks = stat.rsplit(") ").next().and_then(|rest| rest.split(' ').nth(11)?.parse::<f64>().ok());
    ticks.unwrap_or(f64::NAN) / 100.0
}

/// A place in the open space before the camera.
fn place(scene: &PreparedScene, camera: &Camera, film: Film, nth: u32) -> Vec3 {
    let u = |key: u64| uniform_hash(0x5EED_0000 + u64::from(nth) * 16 + key);
    let film_px = Vec2::new(u(0) * film.width as f32, u(1) * film.height as f32);
    let mut ray =
        Ray { origin: camera.position(), direction: camera.direction(film, film_px), t_min: 0.0, t_max: f32::INFINITY };
    let mut sampler = Sampler::new(1, 1, 1);
    for turn in 0..2 {
        let Some(hit) = scene.closest(&ray, &mut sampler) else { break };
        if turn == 1 {
            return ray.origin + ray.direction * hit.t * (0.1 + 0.8 * u(2));
        }
        let normal = if hit.normal.dot(ray.direction) > 0.0 { -hit.normal } else { hit.normal };
        let z = 1.0 - 2.0 * u(3);
        let (sin, cos) = (std::f32::consts::TAU * u(4)).sin_cos();
        let bent = Vec3::new((1.0 - z * z).sqrt() * cos, (1.0 - z * z).sqrt() * sin, z) + normal;
        ray = Ray { origin: hit.origin(normal), direction: bent.normalize(), t_min: 0.0, t_max: f32::INFINITY };
    }
    camera.position()
}

fn light_of(scene: &PreparedScene, patches: &Patches, lamp: Vec3) -> Vec<[f32; 3]> {
    patches.coefficients(&|position, normal| {
        let to_lamp = lamp - position;
        let cos = to_lamp.normalize_or_zero().dot(normal);
        if cos <= 0.0 { Vec3::ZERO } else { scene.transmittance(position, lamp) * cos / to_lamp.length_squared() }
    })
}

/// Two independent pictures of the lamp's indirect light, and of all its light.
struct Reference {
    indirect: [Vec<f32>; 2],
    all: Vec<f32>,
}

impl Reference {
    fn trace(scene: &Scene, camera: &Camera, film: Film, lamp: Vec3, spp: u32) -> Result<Reference, Failure> {
        let mut scene = scene.clone();
        scene.punctual = vec![PunctualLight {
            node: 0,
            kind: PunctualKind::Point,
            position: lamp,
            direction: Vec3::NEG_Y,
            across: [Vec3::X, Vec3::Y],
            profile: None,
            color: Vec3::ONE,
            intensity: 1.0,
        }];
        let (scene, _) = PreparedScene::new(scene, &[])?;
        let basis = &scene.lighting.basis;
        let mut coefficients = vec![[0.0; 3]; basis.n_cols()];
        let source = basis.sources.iter().zip(&scene.lighting.emitters);
        let own = source.filter(|(_, e)| matches!(e, clerestory_transport::emitters::Emitter::Punctual(_)));
        own.for_each(|(s, _)| coefficients[s.columns.start as usize] = [1.0; 3]);
        let picture = |bounces, seed, spp| {
            let config = TraceConfig { spp, bounces, seed };
            let pixels = trace(&scene, camera, film, &coefficients, &config, &|_| ControlFlow::Continue(()));
            pixels.unwrap_or_default().into_iter().flatten().collect::<Vec<f32>>()
        };
        let halves = [1, 2].map(|seed| picture(None, seed, spp));
        let direct = [1, 2].map(|seed| picture(Some(0), seed, spp));
        let less = |half: usize| halves[half].iter().zip(&direct[half]).map(|(a, d)| a - d).collect::<Vec<_>>();
        let indirect = [less(0), less(1)];
        let all = halves[0].iter().zip(&halves[1]).map(|(a, b)| 0.5 * (a + b)).collect();
        Ok(Reference { indirect, all })
    }

    /// Relative L2 of the indirect light free of the references' own noise, PSNR of the whole picture below its 99.5
    /// percentile, and the share of the light that is found.
    fn compare(&self, found: &[f32]) -> [f64; 3] {
        let [a, b] = &self.indirect;
        let [mut off, mut own, mut light, mut sum] = [0.0f64; 4];
        for ((&a, &b), &x) in a.iter().zip(b).zip(found) {
            let [a, b, x] = [a, b, x].map(f64::from);
            off += (x - a) * (x - b);
            own += a * b;
            light += 0.5 * (a + b);
            sum += x;
        }
        let mut sorted = self.all.clone();
        sorted.sort_by(f32::total_cmp);
        let peak = f64::from(sorted[sorted.len() * 995 / 1000]);
        let mean_square = (off / found.len() as f64).max(1e-20);
        [(off.max(0.0) / own).sqrt(), 10.0 * (peak * peak / mean_square).log10(), sum / light]
    }
}
