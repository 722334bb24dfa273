//! Numbers at the ends of what they can be: scenes of a millimeter and of a thousand kilometers, far from the origin, lamps too
//! dim and too bright for any camera, pictures of one pixel and of sixteen thousand in a row. Each is held against the same at
//! everyday numbers, walk by walk; the figures are printed and stand in `docs/reliability.md`.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_relight::Radiance;
use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::light::{LightRig, LightSetting};
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::trace::TraceConfig;
use glam::Vec3;

use crate::support::{SceneFile, Shape, baked, prepare, relit, traced};

const FILM: Film = Film { width: 24, height: 18 };

fn config(spp: u32) -> BakeConfig {
    BakeConfig { spp, tolerance_db: 50.0, seed: 7, ..BakeConfig::default() }
}

/// How a room differs from an everyday one.
#[derive(Clone, Copy)]
struct Room {
    /// Meters of what is one meter.
    scale: f32,
    /// Where its middle is, meters.
    middle: Vec3,
    /// Times the light.
    light: f32,
    /// Texels along a side of its panel.
    texels: u32,
}

const EVERYDAY: Room = Room { scale: 1.0, middle: Vec3::ZERO, light: 1.0, texels: 4 };

impl Room {
    /// Two lamps and a panel in a box, which look the same at any scale.
    fn scene(self) -> Arc<PreparedScene> {
        let Room { scale, middle, light, texels } = self;
        let at = |x: f32, y: f32, z: f32| middle + scale * Vec3::new(x, y, z);
        let block = Shape::room(Vec3::splat(0.25 * scale)).turned().moved(at(0.3, -0.75, -0.3));
        let panel = Shape::quad(at(-0.4, 0.98, -0.4), Vec3::X * 0.8 * scale, Vec3::Z * 0.8 * scale);
        let candela = light * scale * scale;
        let file = SceneFile::default()
            .surface(
                "room",
                &Shape::room(Vec3::splat(scale)).moved(middle),
                SceneFile::lambert([0.7, 0.6, 0.5], [0.0; 3]),
            )
            .surface("block", &block, SceneFile::lambert([0.3, 0.5, 0.7], [0.0; 3]))
            .panel("panel", &panel, [3.0, 2.5, 2.0].map(|nit| nit * light), texels)
            .point_lamp("warm", at(-0.6, 0.3, 0.2), [1.0, 0.7, 0.4], 1.5 * candela)
            .point_lamp("cool", at(0.7, 0.5, -0.5), [0.5, 0.7, 1.0], candela)
            .camera("door", at(0.0, 0.0, 0.95), 1.1);
        prepare(&file.glb())
    }

    fn picture(self) -> Radiance {
        self.picture_of(config(16).seed)
    }

    fn picture_of(self, seed: u64) -> Radiance {
        relit(&baked(&self.scene(), FILM, BakeConfig { seed, ..config(16) }), &LightRig::default())
    }
}

/// Root mean square by which a picture differs from another one times a factor, over the root mean square of that.
#[track_caller]
fn off(picture: &Radiance, factor: f64, other: &Radiance) -> f64 {
    assert_eq!(picture.pixels.len(), other.pixels.len());
    let pairs = picture.pixels.iter().flatten().zip(other.pixels.iter().flatten());
    let pairs = pairs.map(|(x, y)| {
        assert!(x.is_finite(), "{x}");
        (f64::from(*x) / factor, f64::from(*y))
    });
    let (difference, energy) = pairs.fold((0.0, 0.0), |(d, e), (x, y)| (d + (x - y).powi(2), e + y * y));
    assert!(energy > 0.0, "the everyday picture is black");
    (difference / energy).sqrt()
}

fn mean(pixels: &[[f32; 3]]) -> f64 {
    let sum: f64 = pixels.iter().flatten().map(|x| f64::from(*x)).sum();
    assert!(sum.is_finite(), "{sum}");
    sum / (3 * pixels.len()) as f64
}

#[test]
fn extremes_of_scale_and_place_change_no_more_than_rounding_does() {
    let everyday = EVERYDAY.picture();
    // Rounding turns a few walks elsewhere, whose noise is seen.
    for scale in [1e-3, 1e-1, 1e3, 1e6] {
        let off = off(&Room { scale, ..EVERYDAY }.picture(), 1.0, &everyday);
        println!("scale {scale:e}: off by {off:.1e}");
        assert!(off < 0.04, "scale {scale}: {off}");
    }
    let noise = off(&EVERYDAY.picture_of(8), 1.0, &everyday);
    println!("with other random numbers: off by {noise:.1e}");
    // Ten kilometers from the origin a number of 32 bits tells a millimeter: all walks are others.
    for (meters, most) in [(1e2, 0.002), (1e3, 0.004), (1e4, 0.015)] {
        let far = Room { middle: Vec3::new(meters, -meters, meters), ..EVERYDAY }.picture();
        let (off, mean) = (off(&far, 1.0, &everyday), mean(&far.pixels) / mean(&everyday.pixels) - 1.0);
        println!("{meters:e} m from the origin: off by {off:.1e}, the mean by {:.2} %", 100.0 * mean);
        assert!(mean.abs() < most && off < 2.0 * noise, "{meters} m: {off}, mean {mean}");
    }
}

#[test]
fn extremes_of_light_are_as_exact_as_everyday_light() {
    let everyday = EVERYDAY.picture();
    for light in [1e-20, 1e-10, 1e-5, 1e5, 1e10, 1e20] {
        let off = off(&Room { light, ..EVERYDAY }.picture(), f64::from(light), &everyday);
        println!("light of {light:e}: off by {off:.1e}");
        assert!(off < 0.01, "light {light}: {off}");
    }
    let bake = baked(&EVERYDAY.scene(), FILM, config(16));
    for intensity in [0.0, 1e-20, 1e-6, 1e6, 1e20] {
        let names = ["warm", "cool", "panel"].map(String::from);
        let dimmed = names.map(|name| (name, LightSetting { intensity, ..LightSetting::default() }));
        let picture = relit(&bake, &LightRig { lights: dimmed.into(), ..LightRig::default() });
        if intensity == 0.0 {
            assert!(picture.pixels.iter().flatten().all(|x| *x == 0.0), "no light is black");
            continue;
        }
        let off = off(&picture, f64::from(intensity), &relit(&bake, &LightRig::default()));
        println!("intensity {intensity:e}: off by {off:.1e}");
        assert!(off < 1e-5, "intensity {intensity}: {off}");
    }
}

#[test]
fn extremes_of_pictures_and_panels_are_what_tracing_gives() {
    let scene = EVERYDAY.scene();
    for film in [[1, 1], [1, 300], [Film::MAX_SIDE, 1]] {
        let film = Film { width: film[0], height: film[1] };
        // As many samples in all: many pixels tell the mean with few of each.
        let spp = (65_536 / film.n_pixels()).max(8) as u32;
        let picture = relit(&baked(&scene, film, config(spp.min(64))), &LightRig::default());
        let samples = TraceConfig { spp, bounces: None, seed: 3 };
        let traced = mean(&traced(&scene, &LightRig::default(), film, &samples));
        let off = mean(&picture.pixels) / traced - 1.0;
        println!("{} × {} pixels: mean off by {:.2} %", film.width, film.height, 100.0 * off);
        assert!(off.abs() < 0.1, "{} × {}: {off}", film.width, film.height);
    }
    let (one, many) = (Room { texels: 1, ..EVERYDAY }.picture(), EVERYDAY.picture());
    let off = mean(&one.pixels) / mean(&many.pixels) - 1.0;
    println!("a panel of one texel: mean off by {:.2} %", 100.0 * off);
    assert!(off.abs() < 0.05, "a panel of one texel: {off}");
}

#[test]
fn extremes_of_nothing_are_black_or_refused_in_words() {
    let dark = Room { light: 0.0, ..EVERYDAY };
    let bake = baked(&dark.scene(), FILM, config(4));
    assert!(relit(&bake, &LightRig::default()).pixels.iter().flatten().all(|x| *x == 0.0), "lamps without light");

    let wall = SceneFile::lambert([0.7, 0.6, 0.5], [0.0; 3]);
    let unlit = SceneFile::default().surface("room", &Shape::room(Vec3::ONE), wall).camera("door", Vec3::Z * 0.9, 1.1);
    let scene = prepare(&unlit.glb());
    let camera = scene.scene.cameras[0].clone();
    let (passes, irradiance) = (Passes::FinalOnly, Vec::new());
    let job = BakeJob { scene, camera, film: FILM, config: config(4), passes, irradiance };
    match job.run(|_| ControlFlow::Continue(())) {
        Ok(Some(bake)) => {
            let picture = relit(&bake, &LightRig::default());
            assert!(picture.pixels.iter().flatten().all(|x| *x == 0.0), "a room without lamps");
        }
        Ok(None) => panic!("nobody asked to stop"),
        Err(refused) => assert!(refused.to_string().contains("light"), "{refused}"),
    }
}
