//! Pictures out of the window: files with what was chosen about them, and the clipboard.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails")]

#[expect(dead_code, reason = "not every test of the window drags")]
mod desk;

use std::path::Path;

use clerestory::compare::read_exr;
use clerestory::export::layers::LayerSet;
use eframe::egui::{Event, OutputCommand};
use egui_kittest::kittest::{NodeT, Queryable};
use exr::meta::MetaData;

use desk::{Window, baked, click, wait};

/// Opens the questions about a picture and writes the path of its file.
fn export_to(window: &mut Window, path: &Path) {
    click(window, "Export…");
    window.get_by_label("Path").set_text_value_accesskit(&path.display().to_string());
    window.run_steps(3);
}

#[test]
fn an_exr_gets_the_layers_and_the_part_that_were_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.png");
    let mut window = baked();
    export_to(&mut window, &path);
    click(&mut window, "OpenEXR");
    click(&mut window, "Half");
    click(&mut window, "Layers");
    click(&mut window, "By light");
    assert_eq!(window.state().export_options().layers, LayerSet::Lights);
    assert!(window.get_by_label("Illuminance").accesskit_node().is_disabled(), "none was baked");
    click(&mut window, "Region");
    window.get_by_label("Region left").set_value_accesskit(60.0);
    window.run_steps(3);
    window.get_by_label_contains("does not lie within the picture of 64 × 48");
    assert!(window.get_by_label("Save").accesskit_node().is_disabled());
    window.get_by_label("Region width").set_value_accesskit(4.0);
    window.run_steps(3);
    click(&mut window, "Save");
    let path = path.with_extension("exr");
    wait(&mut window, |_| path.exists());
    let header = MetaData::read_from_file(&path, true).unwrap().headers.remove(0);
    let names: Vec<String> = header.channels.list.iter().map(|channel| channel.name.to_string()).collect();
    assert_eq!(names, ["B", "G", "R", "lamp.B", "lamp.G", "lamp.R", "panel.B", "panel.G", "panel.R"]);
    assert_eq!(header.own_attributes.layer_position.0, 60);
    assert_eq!(header.shared_attributes.display_window.size.0, 64);
    let part = read_exr(&path).unwrap();
    assert_eq!((part.width, part.height), (4, 48));
}

#[test]
fn a_png_of_a_smaller_size_is_written() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room.png");
    let mut window = baked();
    export_to(&mut window, &path);
    click(&mut window, "16 bits");
    window.get_by_label("Width of the file").set_value_accesskit(32.0);
    window.run_steps(3);
    click(&mut window, "Save");
    wait(&mut window, |_| path.exists());
    let picture = image::open(&path).unwrap();
    assert_eq!((picture.width(), picture.height(), picture.color()), (32, 24, image::ColorType::Rgb16));
}

#[test]
fn the_picture_is_copied_as_it_is_seen() {
    let mut window = baked();
    let copied = |window: &mut Window| {
        for _ in 0..2000 {
            window.step();
            let commands = &window.output().platform_output.commands;
            let picture = commands.iter().find_map(|command| match command {
                OutputCommand::CopyImage(picture) => Some(picture.clone()),
                _ => None,
            });
            if picture.is_some() {
                return picture.unwrap();
            }
            std::thread::sleep(std::time::Duration::from_millis(2));
        }
        panic!("nothing was copied");
    };
    window.event(Event::Copy);
    let lit = copied(&mut window);
    assert_eq!(lit.size, [64, 48]);
    assert!(lit.pixels.iter().any(|pixel| pixel.r() > 60));
    window.get_by_label_contains("Copied the picture, 64 × 48");
    click(&mut window, "Auto");
    click(&mut window, "Mute lamp");
    click(&mut window, "Mute panel");
    window.event(Event::Copy);
    assert!(copied(&mut window).pixels.iter().all(|pixel| pixel.r() == 0), "no light, and exposure stays");
}
