//! The sky behind the picture in the window: a layer over it, so that a turned sky leaves the factors as they are.

use std::sync::Arc;

use anyhow::Result;
use clerestory_nystrom::BlockFactors;
use clerestory_relight::Radiance;
use clerestory_transport::bake::BakeHeader;
use clerestory_transport::light::LightRig;
use clerestory_transport::sky::Backdrop;
use glam::Vec3;

use crate::session::sky::{self, SkyOrder, SkyWorker, Weights};
use crate::session::{Shown, Wake};

/// Keeps the sky behind the picture in step.
pub(super) struct SkyLayer {
    worker: SkyWorker,
    /// The bake that the rest is of.
    header: Option<Arc<BakeHeader>>,
    /// Blocks of the bake, and what of them sees the sky.
    blocks: Vec<Option<(Arc<BlockFactors>, Arc<Weights>)>>,
    /// What was ordered last.
    backdrop: Option<Backdrop>,
    n_orders: u64,
    /// The first order whose answer counts.
    oldest: u64,
    /// The newest answer, and its number.
    light: Vec<(u32, Vec3)>,
    answered: u64,
    /// The layer that was made last, and of what.
    made: Option<(MadeOf, Arc<Radiance>)>,
}

/// Number of the answer, what multiplies it, and the layer below it.
type MadeOf = (u64, [f32; 3], Option<Arc<Radiance>>);

impl SkyLayer {
    pub fn new(wake: Wake) -> Result<SkyLayer> {
        Ok(SkyLayer {
            worker: sky::start(wake)?,
            header: None,
            blocks: Vec::new(),
            backdrop: None,
            n_orders: 0,
            oldest: 0,
            light: Vec::new(),
            answered: 0,
            made: None,
        })
    }

    /// Whether the sky that is shown is the one that was asked for last.
    pub fn is_idle(&self) -> bool {
        self.answered == self.n_orders
    }

    /// Takes in what came and orders what is new. Answers the number of what is shown, or words for people.
    pub fn follow(&mut self, shown: &Shown, rig: &LightRig) -> Result<u64, String> {
        if self.header.as_ref().is_none_or(|header| !Arc::ptr_eq(header, &shown.header)) {
            (self.header, self.backdrop, self.made) = (Some(shown.header.clone()), None, None);
            (self.oldest, self.answered) = (self.n_orders + 1, self.n_orders);
            self.light.clear();
            self.blocks.clear();
        }
        let mut problem = None;
        if let Some(seen) = self.worker.take().filter(|seen| seen.serial >= self.oldest) {
            self.answered = seen.serial;
            match seen.light {
                Ok(light) => self.light = light,
                Err(words) => problem = Some(words),
            }
        }
        let Some(backdrop) = Backdrop::new(&shown.header, rig) else { return problem.map_or(Ok(0), Err) };
        let is_seen_anew = self.weigh(shown, &backdrop);
        let is_another = self.backdrop.as_ref().is_none_or(|other| !other.shows_the_same(&backdrop));
        let seen = || self.blocks.iter().flatten().map(|(_, weights)| weights);
        if is_seen_anew || is_another && seen().any(|weights| !weights.is_empty()) {
            let weights = seen().cloned().collect();
            self.n_orders += 1;
            self.worker.order(SkyOrder { backdrop: backdrop.clone(), weights, serial: self.n_orders });
        }
        self.backdrop = Some(backdrop);
        problem.map_or(Ok(self.answered), Err)
    }

    /// Reads the weights of blocks that are new; answers whether one of them sees the sky, or did before.
    fn weigh(&mut self, shown: &Shown, backdrop: &Backdrop) -> bool {
        let group = &shown.frame.groups[backdrop.group];
        self.blocks.resize(group.blocks.len(), None);
        let (mut pixels, mut is_new) = (Vec::new(), false);
        for (idx, (block, known)) in group.blocks.iter().zip(&mut self.blocks).enumerate() {
            let Some(block) = block else { continue };
            if known.as_ref().is_some_and(|(known, _)| Arc::ptr_eq(known, block)) {
                continue;
            }
            group.partition.bundles(idx, &mut pixels);
            let weights = backdrop.weights(block, &pixels);
            let saw = known.as_ref().is_some_and(|(_, weights)| !weights.is_empty());
            is_new |= saw || !weights.is_empty();
            *known = Some((block.clone(), Arc::new(weights)));
        }
        is_new
    }

    /// What is laid over the picture: the sky that is seen, and the light of free lamps. The sky's own column, which knows no
    /// map, is put out in `coefficients`.
    pub fn layer(
        &mut self,
        shown: &Shown,
        coefficients: &mut [Vec<[f32; 3]>],
        lamps: Option<Arc<Radiance>>,
    ) -> Option<Arc<Radiance>> {
        let Some(backdrop) = &self.backdrop else { return lamps };
        let factor = std::mem::take(&mut coefficients[backdrop.group][backdrop.column as usize]);
        if self.light.is_empty() {
            return lamps;
        }
        let of = (self.answered, factor, lamps);
        if let Some((_, layer)) = self.made.as_ref().filter(|(made_of, _)| is_same(made_of, &of)) {
            return Some(layer.clone());
        }
        let (width, height) = (shown.header.width, shown.header.height);
        let mut sum = of.2.as_ref().map_or_else(|| Radiance::new(width, height), |lamps| Radiance::clone(lamps));
        for (pixel, light) in &self.light {
            let pixel = &mut sum.pixels[*pixel as usize];
            *pixel = (Vec3::from(*pixel) + *light * Vec3::from(factor)).to_array();
        }
        let layer = Arc::new(sum);
        self.made = Some((of, layer.clone()));
        Some(layer)
    }
}

fn is_same(a: &MadeOf, b: &MadeOf) -> bool {
    let address = |lamps: &Option<Arc<Radiance>>| lamps.as_ref().map(Arc::as_ptr);
    (a.0, a.1, address(&a.2)) == (b.0, b.1, address(&b.2))
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use clerestory_relight::{CpuRelighter, Frame, Relight};
    use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
    use clerestory_transport::camera::Film;
    use clerestory_transport::emitters::SkyRequest;
    use clerestory_transport::import;
    use clerestory_transport::light::LightSetting;
    use clerestory_transport::prepared::PreparedScene;
    use clerestory_transport::sky::{SkyForm, SkySetting};

    use super::*;
    use crate::export::layers::LayerSet;
    use crate::look::Look;
    use crate::look::sky::{remade, typed};
    use crate::support::ROOM;

    /// The room of the process tests without ceiling, front and back, under a sun of its own, baked.
    fn court() -> Shown {
        let gltf = ROOM.replace("\"count\": 36", "\"count\": 18");
        let imported = import::load_bytes("court.gltf", gltf.as_bytes()).unwrap();
        let sky = sky("sun:200,50");
        let request = SkyRequest { light: sky.light(None).unwrap(), form: SkyForm::Patches(1) };
        let scene = Arc::new(PreparedScene::with_sky(imported.scene, &[], Some(&request)).unwrap().0);
        let camera = scene.scene.cameras[0].clone();
        let film = Film { width: 48, height: 36 };
        let config = BakeConfig { spp: 8, tolerance_db: 30.0, ..BakeConfig::default() };
        let job = BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() };
        let bake = job.run(|_| ControlFlow::Continue(())).unwrap().unwrap();
        let frame = Arc::new(Frame { width: film.width, height: film.height, groups: bake.groups.clone() });
        Shown { header: bake.header, camera: None, frame, irradiance: Vec::new(), packed: None, is_glimpse: false }
    }

    fn sky(typed_sky: &str) -> SkySetting {
        remade(&SkySetting::default(), typed(typed_sky).unwrap()).unwrap()
    }

    fn settled(layer: &mut SkyLayer, shown: &Shown, rig: &LightRig) -> u64 {
        for _ in 0..40_000 {
            let number = layer.follow(shown, rig).unwrap();
            if layer.is_idle() {
                return number;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        panic!("no sky came");
    }

    fn picture(frame: &Frame, coefficients: &[Vec<[f32; 3]>], layer: Option<&Arc<Radiance>>) -> Radiance {
        let (mut relighter, mut radiance) = (CpuRelighter::new(frame).unwrap(), Radiance::default());
        relighter.set_layer(layer).unwrap();
        relighter.relight(coefficients, &mut radiance).unwrap();
        radiance
    }

    #[test]
    fn a_moved_sun_and_its_sky_have_layers_and_shares_of_their_own() {
        let (shown, mut look) = (court(), Look::default());
        let bake = shown.bake();
        look.lights.sky = Some(sky("sun:170,50"));
        look.lights.set("sun", LightSetting { intensity: 0.5, ..LightSetting::default() });
        let sun = bake.header.basis.sun_apart(&look.lights).unwrap();
        let relit = |rig: &LightRig| {
            let frame = Frame { groups: bake.groups_under(rig), ..*shown.frame };
            picture(&frame, &bake.header.coefficients(rig), None)
        };
        let (whole, alone) = (relit(&look.lights), relit(&sun.alone));
        let brightest = whole.pixels.as_flattened().iter().copied().fold(0.0, f32::max);
        let assert_close = |found: f32, wanted: f32| {
            assert!((found - wanted).abs() <= 1e-2 * brightest, "{found} is not {wanted}");
        };
        let layers = LayerSet::Lights.layers_with_sun(&bake, &look, &sun).unwrap();
        let layer = |key: &str| layers.iter().find(|layer| layer.key == key).unwrap();
        assert!(layer("sun").radiance.pixels.as_flattened().iter().any(|nit| *nit > 100.0));
        for (idx, pixel) in whole.pixels.iter().enumerate() {
            assert_close(layer("sun").radiance.pixels[idx][1], alone.pixels[idx][1]);
            assert_close(layers.iter().map(|layer| layer.radiance.pixels[idx][1]).sum(), pixel[1]);
        }
        for px in (0..48 * 36).step_by(97) {
            for share in shown.shares(&look.lights, None, &[px]).unwrap() {
                assert_close(share.radiance.y, layer(&share.key).radiance.pixels[px as usize][1]);
            }
        }
    }

    #[test]
    fn the_layer_is_the_sky_that_the_blocks_would_be_lit_with() {
        let shown = court();
        let mut layer = SkyLayer::new(Arc::new(|_| {})).unwrap();
        let (mut last, lamps) = (0, Arc::new(Radiance { pixels: vec![[5.0; 3]; 48 * 36], ..Radiance::new(48, 36) }));
        for (typed_sky, rotation_deg, intensity) in
            [("sun:200,50", 0.0, 1.0), ("sun:200,50", 90.0, 0.5), ("sun:90,8", 0.0, 2.0)]
        {
            let own = SkySetting { rotation_deg, intensity, ..sky(typed_sky) };
            let rig = LightRig { sky: Some(own), ..LightRig::default() };
            let number = settled(&mut layer, &shown, &rig);
            assert!(number > last, "another sky is another picture");
            last = number;
            let whole = shown.header.coefficients(&rig);
            let mut coefficients = whole.clone();
            let over = layer.layer(&shown, &mut coefficients, Some(lamps.clone())).unwrap();
            let lit = Frame { groups: shown.bake().groups_under(&rig), ..*shown.frame };
            let (ours, known) =
                (picture(&shown.frame, &coefficients, Some(&over)), picture(&lit, &whole, Some(&lamps)));
            let brightest = known.pixels.as_flattened().iter().copied().fold(0.0, f32::max);
            for (ours, known) in ours.pixels.as_flattened().iter().zip(known.pixels.as_flattened()) {
                assert!((ours - known).abs() <= 1e-4 * brightest.max(*known), "{ours} {known}");
            }
            assert!(known.pixels[12 * 48 + 24][1] > 50.0, "the sky is seen over the floor");
            assert_eq!(settled(&mut layer, &shown, &rig), number, "what stays as it is is not made again");
        }
    }
}
