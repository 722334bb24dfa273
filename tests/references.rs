//! `trace` against pictures of the Cornell box that Mitsuba made from the very same files (4096 samples per pixel, six
//! bounces, box filter). Needs the shared data.

use std::path::PathBuf;

use clerestory::compare::read_exr;
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::SkyRequest;
use clerestory_transport::import;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sky::{SkyForm, SkyLight};
use clerestory_transport::trace::TraceConfig;

use crate::support::{block_means, shared, traced};

const TILE: usize = 8;
/// Largest difference of a channel's mean.
const MEAN_TOLERANCE: f64 = 3e-3;
/// A block is off where it differs by more standard errors than this.
const Z_MAX: f64 = 3.5;
/// Share of blocks that must not be off.
const SHARE: f64 = 0.995;
/// Root mean square of z. Normal values of the greatest have as many beyond `Z_MAX` as `SHARE` leaves. One far below 1 says that noise is
/// told too great, so that blocks could be off unseen: blue channels come to 0.43 and 0.47, as the noise of a reference is known of all
/// three channels together, and blue is the darkest of them.
const SPREAD: std::ops::RangeInclusive<f64> = 0.4..=1.25;

/// Samples per pixel of the references.
const REFERENCE_SPP: f64 = 4096.0;

/// What is known of a reference.
struct Reference {
    name: &'static str,
    /// Sky that lights it, a file of the shared data.
    sky: Option<&'static str>,
    /// Pixels are clipped here on both sides, so that fireflies do not decide.
    clip: f32,
    /// Root mean square error of one of its pixels, from its README.
    rmse: f64,
    /// Our samples per pixel in each of two independent pictures.
    spp: u32,
}

/// Blocks of two independent pictures of ours against those of a reference.
struct Blocks {
    /// z of each block.
    z: Vec<f64>,
    /// Mean of ours over mean of the reference, minus 1, and its standard error.
    bias: [f64; 2],
}

fn channel(pixels: &[[f32; 3]], channel: usize, clip: f32) -> Vec<f64> {
    pixels.iter().map(|rgb| f64::from(rgb[channel].min(clip))).collect()
}

impl Reference {
    fn paths(&self) -> Option<[PathBuf; 2]> {
        let path = |extension: &str| shared(&format!("references/{}.{extension}", self.name));
        Some([path("glb")?, path("exr")?])
    }

    fn blocks(&self, ours: &[Vec<[f32; 3]>; 2], theirs: &[[f32; 3]], idx: usize, width: usize) -> Blocks {
        // The mean is clipped, not its halves: less of what is clipped is noise.
        let pairs = ours[0].iter().zip(&ours[1]);
        let mean: Vec<[f32; 3]> = pairs.map(|(a, b)| std::array::from_fn(|c| 0.5 * (a[c] + b[c]))).collect();
        let [mean, theirs] = [&mean, theirs].map(|pixels: &[[f32; 3]]| channel(pixels, idx, self.clip));
        let [a, b] = [0, 1].map(|i| channel(&ours[i], idx, self.clip));
        // The mean of two pixels has the variance (a − b)² / 4, and the reference that of its many more samples; the
        // variance of a block's mean is estimated by its 64 pixels.
        let samples_ratio = f64::from(2 * self.spp) / REFERENCE_SPP;
        let pixel_variance = |(a, b): (&f64, &f64)| {
            let own = (a - b).powi(2) / 4.0;
            own + (own * samples_ratio).max(self.rmse * self.rmse)
        };
        let variances = block_means(&a.iter().zip(&b).map(pixel_variance).collect::<Vec<_>>(), width, TILE);
        let noise = (variances.iter().sum::<f64>() / variances.len() as f64 / theirs.len() as f64).sqrt();
        let difference: Vec<f64> = mean.iter().zip(&theirs).map(|(ours, theirs)| ours - theirs).collect();
        let z = block_means(&difference, width, TILE).into_iter().zip(&variances);
        let z = z.map(|(d, v)| d / (v / (TILE * TILE) as f64).sqrt()).collect();
        let sum = theirs.iter().sum::<f64>();
        Blocks { z, bias: [difference.iter().sum::<f64>() / sum, noise * theirs.len() as f64 / sum] }
    }

    fn check(&self) {
        let Some([glb, exr]) = self.paths() else { return };
        let theirs = read_exr(&exr).unwrap();
        let imported = import::load(&glb).unwrap();
        let sky = self.sky.map(|file| {
            let (map, _) = import::load_sky(&shared(file).unwrap()).unwrap();
            SkyRequest { light: SkyLight::new(file, map), form: SkyForm::Whole }
        });
        let (scene, _) = PreparedScene::with_sky(imported.scene, &[], sky.as_ref()).unwrap();
        let film = Film { width: theirs.width, height: theirs.height };
        let config = |seed| TraceConfig { spp: self.spp, bounces: Some(6), seed };
        let ours = [1, 2].map(|seed| traced(&scene, &LightRig::default(), film, &config(seed)));
        for idx in 0..3 {
            let blocks = self.blocks(&ours, &theirs.pixels, idx, film.width as usize);
            let n_off = blocks.z.iter().filter(|z| z.abs() > Z_MAX).count();
            let share = 1.0 - n_off as f64 / blocks.z.len() as f64;
            let spread = (blocks.z.iter().map(|z| z * z).sum::<f64>() / blocks.z.len() as f64).sqrt();
            let [bias, error] = blocks.bias;
            let told = format!(
                "{} channel {idx}: mean off by {bias:+.5} ± {error:.5}, blocks within {share:.4}, spread of z {spread:.3}",
                self.name
            );
            println!("{told}");
            assert!(4.0 * error < MEAN_TOLERANCE, "{told}: the mean is too blurred");
            assert!(bias.abs() <= MEAN_TOLERANCE, "{told}: the mean is off by more than {MEAN_TOLERANCE}");
            assert!(share >= SHARE, "{told}: {SHARE} of the blocks have to be within {Z_MAX}");
            assert!(SPREAD.contains(&spread), "{told}: the spread has to be within {SPREAD:?}");
        }
    }
}

#[test]
fn tracing_agrees_with_the_diffuse_cornell_box() {
    Reference { name: "cornell-diffuse", sky: None, clip: f32::INFINITY, rmse: 0.0015, spp: 96 }.check();
}

#[test]
fn tracing_agrees_with_mirrors_glass_and_caustics() {
    Reference { name: "cornell-specular", sky: None, clip: 3.0, rmse: 0.0043, spp: 256 }.check();
}

#[test]
fn tracing_agrees_with_the_box_that_is_open_to_a_captured_sky() {
    let sky = Some("env/vestibule_1k.hdr");
    Reference { name: "cornell-open", sky, clip: f32::INFINITY, rmse: 0.004, spp: 32 }.check();
}
