//! Two ways to one answer: path tracing and relighting, CPU and GPU.

use clerestory_relight::display::WhitePoint;
use clerestory_relight::{GpuRelighter, Radiance, Relight};
use clerestory_transport::bake::{Bake, BakeConfig, SIDES};
use clerestory_transport::camera::Film;
use clerestory_transport::light::{LightRig, LightSetting, PanelSpot, planckian_tint};
use clerestory_transport::trace::TraceConfig;

use crate::support::{Mean, baked, block_means, frame, gpus, prepare, relit, traced, two_lamps_and_a_panel};

const FILM: Film = Film { width: 48, height: 32 };

/// Uniform light, and a lamp and a spot that were moved.
fn rigs() -> [LightRig; 2] {
    let mut rig = LightRig::default();
    rig.lights.insert("warm".into(), LightSetting { intensity: 0.25, kelvin: Some(6500.0), ..LightSetting::default() });
    let spot = PanelSpot { position: [0.25, 0.6], radius: 0.2, color: Some([0.2, 0.5, 1.0]), intensity: 2.0 };
    rig.panels.insert("panel".into(), vec![spot]);
    [LightRig::default(), rig]
}

#[test]
fn the_white_balance_of_a_temperature_makes_its_lamps_neutral() {
    // Each crate has its own fit of the Planckian locus, since neither may know the other.
    for kelvin in [1700.0, 2200.0, 2700.0, 3500.0, 4100.0, 6500.0, 12_000.0, 24_000.0] {
        let tint = planckian_tint(kelvin).to_array();
        let matrix = WhitePoint { kelvin, duv: 0.0 }.matrix();
        let [r, g, b] = matrix.map(|row| row.iter().zip(tint).map(|(m, v)| m * v).sum::<f32>());
        // Far from daylight the tint leaves the colors of the display, and is cut off there.
        let is_displayed = tint.iter().all(|v| *v > 0.0);
        assert!(!is_displayed || (r - g).abs().max((b - g).abs()) < 2e-3, "{kelvin} K: {r} {g} {b}");
        assert!(is_displayed || kelvin < 2000.0, "{kelvin} K: {tint:?}");
    }
}

fn green_blocks(pixels: &[[f32; 3]]) -> Vec<f64> {
    let green: Vec<f64> = pixels.iter().map(|rgb| f64::from(rgb[1])).collect();
    block_means(&green, FILM.width as usize, 8)
}

#[test]
fn relighting_shows_what_tracing_shows() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let bake = |seed| baked(&scene, FILM, BakeConfig { spp: 192, seed, block: 8, ..BakeConfig::default() });
    let bakes: [Bake; 2] = [bake(1), bake(2)];
    for rig in rigs() {
        let picture = |seed| traced(&scene, &rig, FILM, &TraceConfig { spp: 192, bounces: None, seed });
        let traces = [3, 4].map(|seed| green_blocks(&picture(seed)));
        let relights = [0, 1].map(|i| green_blocks(&relit(&bakes[i], &rig).pixels));
        let scale = traces[0].iter().sum::<f64>() / traces[0].len() as f64;

        // Blocks of eight pixels are traced and compressed each for itself, so their differences are independent.
        let n = traces[0].len();
        let differences =
            (0..n).map(|i| (relights[0][i] + relights[1][i] - traces[0][i] - traces[1][i]) / (2.0 * scale));
        let differences: Vec<f64> = differences.collect();
        Mean::of(differences.iter().copied()).assert_is(0.0, 2e-3, 2.5e-3);

        // No single block may stand out either: its noise is judged by all blocks of both pairs.
        let pairs = [&traces, &relights].map(|[a, b]| (0..n).map(|i| ((a[i] - b[i]) / scale).powi(2)).sum::<f64>());
        let sigma = ((pairs[0] + pairs[1]) / (4.0 * n as f64)).sqrt();
        let worst = differences.iter().map(|d| d.abs()).fold(0.0, f64::max);
        assert!(sigma < 0.05, "noise of {sigma} hides every fault");
        assert!(worst < 6.0 * sigma + 0.01, "a block is off by {worst}, its noise is {sigma}");
    }
}

#[test]
fn every_device_agrees_with_the_cpu() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let gpus = gpus();
    for block in SIDES {
        let bake = baked(&scene, FILM, BakeConfig { spp: 16, block, ..BakeConfig::default() });
        let frame = frame(&bake);
        for (gpu, rig) in gpus.iter().flat_map(|gpu| rigs().into_iter().map(move |rig| (gpu, rig))) {
            let mut relighter = GpuRelighter::new(gpu, &frame).unwrap();
            let mut on_gpu = Radiance::default();
            relighter.relight(&bake.header.coefficients(&rig), &mut on_gpu).unwrap();
            let on_cpu = relit(&bake, &rig);
            let brightest = on_cpu.pixels.iter().flatten().copied().fold(0.0, f32::max);
            for (gpu, cpu) in on_gpu.pixels.iter().flatten().zip(on_cpu.pixels.iter().flatten()) {
                // Relative, and absolute far below what is seen: the order of additions differs.
                let far = (gpu - cpu).abs() > 1e-3 * cpu.abs() + 1e-5 * brightest;
                assert!(!far, "{gpu} on the GPU, {cpu} on the CPU, blocks of {block}");
            }
        }
    }
}

#[test]
fn a_picture_is_the_same_whatever_the_side_of_its_blocks() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let pictures = SIDES.map(|block| {
        let config = BakeConfig { spp: 16, denoise: false, block, tolerance_db: 90.0, ..BakeConfig::default() };
        relit(&baked(&scene, FILM, config), &LightRig::default()).pixels
    });
    let energy = |values: &mut dyn Iterator<Item = f32>| values.map(|x| f64::from(x).powi(2)).sum::<f64>();
    let usual = || pictures[1].iter().flatten().copied();
    for (picture, block) in pictures.iter().zip(SIDES) {
        // The samples are the same, and the picture of the file is kept as it was sampled, to a quarter of its noise.
        let difference = energy(&mut picture.iter().flatten().zip(usual()).map(|(x, usual)| x - usual));
        let off = (difference / energy(&mut usual())).sqrt();
        assert!(off < 0.01, "{off} off with blocks of {block}");
    }
}

#[test]
fn a_bake_is_the_same_on_any_number_of_threads() {
    let scene = prepare(&two_lamps_and_a_panel().glb());
    let on = |n_threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        pool.install(|| baked(&scene, FILM, BakeConfig { spp: 8, ..BakeConfig::default() }))
    };
    let (one, three) = (on(1), on(3));
    assert_eq!(one.header, three.header);
    for (a, b) in one.groups.iter().zip(&three.groups) {
        assert_eq!(a.blocks, b.blocks);
    }
}
