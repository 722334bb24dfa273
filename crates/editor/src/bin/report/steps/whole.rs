//! A whole picture after a lamp has moved, by the parts of the window that make it.

use std::sync::Arc;
use std::sync::mpsc::{Receiver, channel};
use std::time::{Duration, Instant};

use anyhow::{Context, Result, bail, ensure};
use clerestory::look::Display;
use clerestory::picture::Changed;
use clerestory::session::lamps::{self, LampLight, LampOrder, LampView, LampWorker};
use clerestory::session::worker::{Order, Wanted, Worker};
use clerestory::session::{Shown, Wake};
use clerestory_relight::{DisplayParams, Frame, Gpu, GpuRelighter, Precision, Radiance, Relight};
use clerestory_transport::bake::Bake;
use clerestory_transport::camera::Camera;
use clerestory_transport::lamps::FreeLamp;
use clerestory_transport::light::LightRig;
use clerestory_transport::prepared::PreparedScene;

use crate::rendered::relit;

/// For each part of a step, after which something is wrong.
const PATIENCE: Duration = Duration::from_secs(120);

/// A bake that is shown, and the threads and devices that light and relight it.
pub(super) struct Window {
    shown: Shown,
    view: Arc<LampView>,
    lamps: LampWorker,
    maker: Maker,
    woken: Receiver<()>,
    /// Exposed as the picture without lamps: what a lamp does while it is moved is not metered.
    display: Display,
    changed: Changed,
    /// Lamps that shine beside the one that moves.
    standing: Vec<FreeLamp>,
    n_orders: u64,
}

/// What relights and encodes.
enum Maker {
    Cpu(Worker),
    Device(Gpu, Box<GpuRelighter>),
}

impl Window {
    /// Without a device the CPU does all of it.
    pub fn new(bake: &Bake, scene: &Arc<PreparedScene>, camera: &Camera, device: Option<&Gpu>) -> Result<Window> {
        let (wake, woken) = channel();
        let wake: Wake = Arc::new(move |_| {
            // Nobody listens any more once the window is gone.
            let _ = wake.send(());
        });
        let header = bake.header.clone();
        let frame = Arc::new(Frame { width: header.width, height: header.height, groups: bake.groups.clone() });
        let pixels = relit(bake, &header.coefficients(&LightRig::default()));
        let picture = Radiance { pixels: pixels.as_chunks().0.to_vec(), width: header.width, height: header.height };
        let exposure_ev = Some(Display::default().metered(&picture).exposure_ev);
        let maker = match device {
            None => Maker::Cpu(Worker::start(wake.clone())?),
            Some(gpu) => {
                Maker::Device(gpu.clone(), Box::new(GpuRelighter::with_precision(gpu, &frame, Precision::ByError)?))
            }
        };
        let (irradiance, packed, is_glimpse) = (Vec::new(), None, false);
        let shown = Shown { header, camera: Some(camera.clone()), frame, irradiance, packed, is_glimpse };
        let view = LampView {
            scene: scene.clone(),
            camera: camera.clone(),
            film: shown.film(),
            patches: shown.patches().cloned(),
            measures: false,
            bounces: bake.header.config.bounces,
            device: device.cloned(),
        };
        Ok(Window {
            shown,
            view: Arc::new(view),
            lamps: lamps::start(wake)?,
            maker,
            woken,
            display: Display { exposure_ev, ..Display::default() },
            changed: Changed::All,
            standing: Vec::new(),
            n_orders: 0,
        })
    }

    /// Lamps that shine from now on beside the one that moves: the next step waits for their first light.
    pub fn stand(&mut self, lamps: Vec<FreeLamp>) {
        self.standing = lamps;
    }

    /// Seconds from a lamp that was moved to the encoded picture of all light.
    pub fn step(&mut self, lamp: FreeLamp) -> Result<f64> {
        let begun = Instant::now();
        self.n_orders += 1;
        let (view, serial) = (self.view.clone(), self.n_orders);
        let lamps = self.standing.iter().cloned().chain([lamp]).collect();
        self.lamps.order(LampOrder { view, lamps, shows_arriving: false, serial });
        let is_it = |light: &LampLight| light.serial == serial && light.left_out.is_empty();
        let light = wait_for(&self.woken, || self.lamps.take().filter(is_it))?;
        let told = [light.problems.as_slice(), light.remarks.as_slice()].concat();
        ensure!(told.is_empty(), "{}", told.join("; "));
        ensure!(light.parts.len() == self.standing.len() + 1, "{} lamps shine", light.parts.len());
        let coefficients = self.shown.coefficients(&LightRig::default(), Some(&light));
        match &mut self.maker {
            Maker::Cpu(worker) => {
                let (frame, display, wanted) = (self.shown.frame.clone(), self.display, Wanted::Picture);
                let (changed, layer) = (std::mem::take(&mut self.changed), Some(light.direct));
                worker.order(Order { frame, changed, coefficients, layer, display, wanted, serial });
                if let Err(why) = wait_for(&self.woken, || worker.take())? {
                    bail!("{why}");
                }
            }
            Maker::Device(gpu, relighter) => {
                relighter.set_layer(Some(&light.direct))?;
                relighter.relight_to_texture(&coefficients, &self.display.as_metered(&DisplayParams::default()))?;
                gpu.wait()?;
            }
        }
        Ok(begun.elapsed().as_secs_f64())
    }
}

/// What a thread answers, once it does.
fn wait_for<T>(woken: &Receiver<()>, mut take: impl FnMut() -> Option<T>) -> Result<T> {
    loop {
        if let Some(answer) = take() {
            return Ok(answer);
        }
        woken.recv_timeout(PATIENCE).context("no light came")?;
    }
}

#[cfg(test)]
mod tests {
    use clerestory::headless::GALLERY;
    use clerestory_transport::bake::BakeConfig;
    use clerestory_transport::camera::Film;
    use clerestory_transport::import;
    use clerestory_transport::lamps::LampShape;
    use glam::Vec3;

    use super::*;
    use crate::lamps::lamp;
    use crate::lamps::spent::bake;

    #[test]
    fn a_lamp_moves_among_others_that_stand() {
        let scene = import::load_bytes("gallery.glb", GALLERY).unwrap().scene;
        let scene = Arc::new(PreparedScene::new(scene, &[]).unwrap().0);
        let (camera, film) = (&scene.scene.cameras[0], Film { width: 16, height: 12 });
        let config = BakeConfig { spp: 2, patches: 32, ..BakeConfig::default() };
        let (bake, _) = bake(&scene, camera, film, config).unwrap();
        let mut window = Window::new(&bake, &scene, camera, None).unwrap();
        let at = |x: f32| FreeLamp { key: format!("{x}"), ..lamp(LampShape::Point, Vec3::new(x, 1.9, 0.8)) };
        // Alone, among two that are lit first, and once more.
        for (nth, standing) in [vec![], vec![at(0.0), at(0.5)], vec![at(0.0), at(0.5)]].into_iter().enumerate() {
            window.stand(standing);
            assert!(window.step(at(-0.5 - 0.1 * nth as f32)).unwrap() > 0.0);
        }
    }
}
