//! What unit tests share: the room of the process tests, read, prepared, to be baked, and in a window; a lamp; a drag of the pointer.

use std::sync::Arc;

use clerestory_transport::bake::{BakeConfig, BakeJob, Passes};
use clerestory_transport::camera::Film;
use clerestory_transport::import;
use clerestory_transport::lamps::{FreeLamp, LampShape, LampUnit};
use clerestory_transport::light::LightSetting;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::scene::Scene;
use eframe::egui::Pos2;
use egui_kittest::Harness;
use glam::Vec3;

use crate::app::{App, Start};
use crate::session::{BakeSettings, Source};

/// A closed box from −1 to 1 with one lamp, seen from (0, 0, 0.9) along −Z.
pub(crate) const ROOM: &str = include_str!("../tests/room.gltf");

pub(crate) fn room() -> Scene {
    import::load_bytes("room.gltf", ROOM.as_bytes()).unwrap().scene
}

/// The room that many times as large, its camera and lamp where they were.
pub(crate) fn scaled_room(scale: f32) -> Scene {
    let mut scene = room();
    scene.mesh.positions.iter_mut().for_each(|position| *position *= scale);
    scene
}

/// A point of 1 cd at the origin.
pub(crate) fn lamp(key: &str) -> FreeLamp {
    FreeLamp {
        key: key.into(),
        shape: LampShape::Point,
        position: Vec3::ZERO,
        aim: Vec3::NEG_Y,
        strength: 1.0,
        unit: LampUnit::Candela,
        setting: LightSetting::default(),
        turn_rad: 0.0,
        replaces: None,
    }
}

pub(crate) fn prepared_room() -> PreparedScene {
    PreparedScene::new(room(), &[]).unwrap().0
}

/// One pass of the room as its first camera sees it.
pub(crate) fn room_job(film: Film, config: BakeConfig) -> BakeJob {
    let scene = Arc::new(prepared_room());
    let camera = scene.scene.cameras[0].clone();
    BakeJob { scene, camera, film, config, passes: Passes::FinalOnly, irradiance: Vec::new() }
}

pub(crate) fn room_source() -> Source {
    Source::Bytes { name: "room.gltf".into(), bytes: ROOM.as_bytes().to_vec() }
}

/// A window that opens the room, with nothing of the user's.
pub(crate) fn room_window(settings: Option<BakeSettings>) -> Harness<'static, App> {
    let start = Start::alone(room_source(), settings);
    Harness::builder().build_eframe(|cc| App::new(cc, start).unwrap())
}

/// Takes what is at one place to another, where it is held still.
pub(crate) fn pull<State>(window: &mut Harness<'_, State>, from: Pos2, to: Pos2) {
    window.hover_at(from);
    window.run_steps(2);
    window.drag_at(from);
    window.run_steps(2);
    window.hover_at(to);
    window.run_steps(2);
}
