//! What is asked about a picture file beside its name.

use std::path::{Path, PathBuf};

use eframe::egui::{self, Button, ComboBox, RichText, Ui};

use super::number::{Number, before_drag};
use crate::action::{Action, FileTask};
use crate::export::ImageFormat;
use crate::export::layers::LayerSet;
use crate::export::options::{ExportOptions, ExrCompression, ExrSamples, PngDepth, Region};
use crate::look::Units;
use crate::sequence::{MOST_FRAMES, Pattern};

/// What the questions are about.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ExportView<'a> {
    /// The name of a file that was suggested.
    pub suggested: &'a str,
    /// Size of the bake in pixels.
    pub baked: [u32; 2],
    /// What its numbers count.
    pub units: Units,
    /// Whether the light that arrives at the pixels was baked.
    pub has_illuminance: bool,
    /// Whether a bake of it is under way.
    pub is_under_way: bool,
    /// What is marked lies within these corners, in shares of width and height.
    pub marked: Option<[[f32; 2]; 2]>,
    /// The same of what is in sight, where that is a part.
    pub seen: Option<[[f32; 2]; 2]>,
}

const LAYERS: [(LayerSet, &str); 3] =
    [(LayerSet::None, "None"), (LayerSet::Groups, "By group of lights"), (LayerSet::Lights, "By light")];

/// Asks; changes the ending of the path where the format is another one. Answers what is wrong, in words.
pub fn export_ui(
    ui: &mut Ui,
    path: &mut String,
    options: &mut ExportOptions,
    view: &ExportView,
    actions: &mut Vec<Action>,
) -> Option<String> {
    let written = ImageFormat::of(&whole(FileTask::Export, path));
    let format = written.as_ref().ok().copied();
    egui::Grid::new("export").num_columns(2).spacing([14.0, 7.0]).show(ui, |ui| {
        ui.label("Format");
        ui.horizontal(|ui| format_ui(ui, path, format, view.suggested));
        ui.end_row();
        match format {
            Some(ImageFormat::Exr) => exr_rows(ui, options, view),
            _ => png_rows(ui, options),
        }
        ui.label("Size");
        ui.horizontal(|ui| width_ui(ui, options, view.baked));
        ui.end_row();
        ui.label("Part");
        ui.horizontal_wrapped(|ui| region_ui(ui, options, view.baked));
        ui.end_row();
        view_row(ui, options, view);
    });
    ui.add_space(4.0);
    let hint = match (format, view.units) {
        (Some(ImageFormat::Exr), Units::Photometric) => {
            "Linear Rec. 709 in cd/m², with the look inside; exposure and tone are not applied"
        }
        (Some(ImageFormat::Exr), Units::Relative) => {
            "Linear Rec. 709 as it was taken, with the look inside; exposure and tone are not applied"
        }
        _ => "sRGB as it is seen, with the legend where colors are false",
    };
    // A line of its own: beside a button the longer of the two would be cut off.
    ui.label(RichText::new(hint).weak().small());
    under_way_ui(ui, view);
    let copy = ui.button("Copy picture").on_hover_text("Put the picture on the clipboard as it is seen");
    if copy.clicked() {
        actions.push(Action::CopyImage);
    }
    ui.add_space(6.0);
    let unnamed = written.err().filter(|_| !path.trim().is_empty());
    unnamed.or(options.window(view.baked).err()).map(|error| error.to_string())
}

/// Says of what is still being baked that no more of it is written than there is.
fn under_way_ui(ui: &mut Ui, view: &ExportView) {
    if view.is_under_way {
        let words = "A bake is under way: what is known so far is written";
        ui.add(egui::Label::new(RichText::new(words).color(ui.visuals().warn_fg_color).small()).wrap());
    }
}

/// The file that is meant by what was typed.
fn whole(task: FileTask, path: &str) -> PathBuf {
    task.whole(PathBuf::from(path.trim()))
}

/// How many frames are asked for of those up to `last`; all where nobody asks.
fn n_asked(asked: Option<[u32; 2]>, last: u32) -> u32 {
    let [first, end] = asked.unwrap_or([0, last]);
    end.saturating_sub(first).saturating_add(1)
}

/// Asks which frames are written and how, and says how many there will be. Answers what is wrong, in words.
pub fn frames_ui(
    ui: &mut Ui,
    path: &mut String,
    options: &mut ExportOptions,
    view: &ExportView,
    (asked, last, fps): (&mut Option<[u32; 2]>, u32, f32),
) -> Option<String> {
    let meant = whole(FileTask::ExportFrames, path);
    let format = ImageFormat::of(&meant).ok();
    egui::Grid::new("frames").num_columns(2).spacing([14.0, 7.0]).show(ui, |ui| {
        ui.label("Frames");
        ui.horizontal(|ui| range_ui(ui, asked, last));
        ui.end_row();
        ui.label("");
        ui.label(format!("{} at {fps} fps", n_asked(*asked, last)));
        ui.end_row();
        ui.label("Format");
        ui.horizontal(|ui| format_ui(ui, path, format, view.suggested));
        ui.end_row();
        match format {
            Some(ImageFormat::Exr) => numbers_rows(ui, options),
            _ => png_rows(ui, options),
        }
        ui.label("Size");
        ui.horizontal(|ui| width_ui(ui, options, view.baked));
        ui.end_row();
        ui.label("Part");
        ui.horizontal_wrapped(|ui| region_ui(ui, options, view.baked));
        ui.end_row();
        view_row(ui, options, view);
    });
    ui.add_space(4.0);
    under_way_ui(ui, view);
    let n_frames = n_asked(*asked, last);
    if n_frames > MOST_FRAMES {
        return Some(format!(
            "{n_frames} frames are more than the {MOST_FRAMES} that a sequence may have; ask for fewer, put the last key earlier, \
             or take fewer in a second"
        ));
    }
    let unnamed = Pattern::new(&meant).err().filter(|_| !path.trim().is_empty());
    unnamed.or(options.window(view.baked).err()).map(|error| error.to_string())
}

/// From which frame to which.
fn range_ui(ui: &mut Ui, asked: &mut Option<[u32; 2]>, last: u32) {
    let [mut from, mut to] = asked.unwrap_or([0, last]);
    let first = ui.add(Number::new(&mut from).range(0..=last));
    let first = first.on_hover_text("Number of the first frame that is written").accessible_name("First frame");
    ui.label("to");
    let end = ui.add(Number::new(&mut to).range(0..=last));
    let end = end.on_hover_text("Number of the last frame that is written").accessible_name("Last frame");
    // The one that is changed takes the other along.
    if first.changed() {
        *asked = Some([from, to.max(from)]);
    } else if end.changed() {
        *asked = Some([from.min(to), to]);
    }
}

fn format_ui(ui: &mut Ui, path: &mut String, format: Option<ImageFormat>, suggested: &str) {
    let choices = [
        (ImageFormat::Png, "PNG", "png", "A picture for people: sRGB, as it is seen"),
        (ImageFormat::Exr, "OpenEXR", "exr", "Light for other programs: linear, with layers"),
    ];
    for (choice, name, ending, hint) in choices {
        if ui.radio(format == Some(choice), name).on_hover_text(hint).clicked() {
            // What stands behind another dot is a part of the name.
            let stem = match format {
                _ if path.trim().is_empty() => Path::new(suggested).with_extension("").display().to_string(),
                Some(_) => Path::new(path.trim()).with_extension("").display().to_string(),
                None => path.trim().to_owned(),
            };
            *path = format!("{stem}.{ending}");
        }
    }
}

fn png_rows(ui: &mut Ui, options: &mut ExportOptions) {
    ui.label("Depth");
    ui.horizontal(|ui| {
        ui.radio_value(&mut options.depth, PngDepth::Eight, "8 bits").on_hover_text("Per channel");
        ui.radio_value(&mut options.depth, PngDepth::Sixteen, "16 bits")
            .on_hover_text("Per channel, for gradients that are worked on");
    });
    ui.end_row();
}

fn exr_rows(ui: &mut Ui, options: &mut ExportOptions, view: &ExportView) {
    numbers_rows(ui, options);
    let label = ui.label("Layers");
    let current = LAYERS.iter().find(|(set, _)| *set == options.layers).map_or("", |(_, name)| *name);
    let combo = ComboBox::from_id_salt("layers").selected_text(current).show_ui(ui, |ui| {
        for (set, name) in LAYERS {
            ui.selectable_value(&mut options.layers, set, name);
        }
    });
    combo.response.labelled_by(label.id).on_hover_text("They add up to the picture");
    ui.end_row();
    ui.label("");
    let lux =
        ui.add_enabled_ui(view.has_illuminance, |ui| ui.checkbox(&mut options.irradiance, "Illuminance layer")).inner;
    lux.on_hover_text("The light that arrives, in lux per channel")
        .on_disabled_hover_text("This bake holds no illuminance");
    ui.end_row();
}

/// How an EXR keeps its numbers.
fn numbers_rows(ui: &mut Ui, options: &mut ExportOptions) {
    let is_lossy = options.compression == ExrCompression::Dwaa;
    ui.label("Numbers");
    ui.horizontal(|ui| {
        let mut samples = options.exr_samples();
        let half = ui.radio_value(&mut samples, ExrSamples::Half, "Half");
        half.on_hover_text("16-bit floats, up to 65504; half the size");
        let float = ui.add_enabled_ui(!is_lossy, |ui| ui.radio_value(&mut samples, ExrSamples::Float, "Float")).inner;
        float.on_hover_text("32-bit floats").on_disabled_hover_text("DWAA keeps halves");
        if !is_lossy {
            options.samples = samples;
        }
    });
    ui.end_row();
    let label = ui.label("Compression");
    let name = |wanted: ExrCompression| ExrCompression::ALL.iter().find(|(c, _)| *c == wanted).map_or("", |(_, n)| *n);
    let combo = ComboBox::from_id_salt("compression").selected_text(name(options.compression));
    let combo = combo.show_ui(ui, |ui| {
        for (compression, name) in ExrCompression::ALL {
            let choice = ui.selectable_value(&mut options.compression, compression, name);
            choice.on_hover_text(compression_words(compression));
        }
    });
    combo.response.labelled_by(label.id).on_hover_text(compression_words(options.compression));
    ui.end_row();
}

/// What a compression is good for.
fn compression_words(compression: ExrCompression) -> &'static str {
    match compression {
        ExrCompression::None => "Nothing is made smaller",
        ExrCompression::Zip => "Loses nothing; what every program reads",
        ExrCompression::Piz => "Loses nothing; smaller where the picture has grain",
        ExrCompression::Dwaa => {
            "About a third as large; loses what is hard to see, so that layers add up to the picture only nearly"
        }
    }
}

fn width_ui(ui: &mut Ui, options: &mut ExportOptions, baked: [u32; 2]) {
    let mut width = options.width_px.unwrap_or(baked[0]);
    let number = ui.add(Number::new(&mut width).range(1..=baked[0])).accessible_name("Width of the file");
    let before = before_drag(ui, &number, *options);
    if number.on_hover_text("Pixels across, at most as many as were baked; the region keeps its part").changed() {
        *options = before.of_width(width, baked);
    }
    let height = options.whole(baked).map_or(baked[1], |[_, height]| height);
    ui.label(format!("× {height}"));
    ui.weak(format!("of {} × {}", baked[0], baked[1]));
}

fn region_ui(ui: &mut Ui, options: &mut ExportOptions, baked: [u32; 2]) {
    let [width, height] = options.whole(baked).unwrap_or(baked);
    let mut is_part = options.region.is_some();
    let hint = "Write a part alone; an EXR remembers where in the picture it lies";
    if ui.checkbox(&mut is_part, "Region").on_hover_text(hint).changed() {
        options.region = is_part.then_some(Region { x: 0, y: 0, width, height });
    }
    let Some(region) = &mut options.region else { return };
    let numbers = [
        (&mut region.x, 0..=width - 1, "x ", "Region left"),
        (&mut region.y, 0..=height - 1, "y ", "Region top"),
        (&mut region.width, 1..=width, "w ", "Region width"),
        (&mut region.height, 1..=height, "h ", "Region height"),
    ];
    for (value, range, prefix, name) in numbers {
        let number = Number::new(value).range(range.clone()).leaves_what_is_outside().prefix(prefix);
        if ui.add(number).on_hover_text("Pixels").accessible_name(name).changed() {
            *value = (*value).clamp(*range.start(), *range.end());
        }
    }
}

/// The region as it is marked, or in sight.
fn view_row(ui: &mut Ui, options: &mut ExportOptions, view: &ExportView) {
    ui.label("");
    ui.horizontal(|ui| {
        let choices = [
            ("As marked", view.marked, "What is marked in the picture", "Mark a part of the picture in Measure first"),
            ("As shown", view.seen, "What is in sight", "The whole picture is in sight; zoom to a part of it first"),
        ];
        for (name, part, tip, why) in choices {
            let button = ui.add_enabled(part.is_some(), Button::new(name)).on_hover_text(tip);
            if button.on_disabled_hover_text(why).clicked() {
                let whole = options.whole(view.baked).unwrap_or(view.baked);
                options.region = part.map(|corners| Region::between(corners, whole));
            }
        }
    });
    ui.end_row();
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;

    use eframe::egui::vec2;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    use super::*;
    use crate::theme;

    /// Room for the question in the least window with letters of twice the size, points.
    const LEAST_WIDTH: f32 = 410.0;

    #[test]
    fn the_numbers_of_a_region_of_a_large_picture_stay_within_a_narrow_question() {
        let baked = [16_384; 2];
        let view = ExportView {
            suggested: "room.exr",
            baked,
            units: Units::Photometric,
            has_illuminance: false,
            is_under_way: false,
            marked: None,
            seen: None,
        };
        let region = Some(Region { x: 12_288, y: 12_288, width: 4096, height: 4096 });
        let (mut options, mut path) = (ExportOptions { region, ..ExportOptions::default() }, String::from("room.exr"));
        let edge = Cell::new(0.0);
        let mut window = Harness::builder().with_size(vec2(600.0, 600.0)).build_ui(|ui| {
            theme::apply(ui.ctx());
            ui.set_width(LEAST_WIDTH);
            edge.set(ui.max_rect().right());
            export_ui(ui, &mut path, &mut options, &view, &mut Vec::new());
        });
        window.run_steps(4);
        for label in ["Region left", "Region top", "Region width", "Region height"] {
            let right = window.get_by_label(label).rect().right();
            assert!(right <= edge.get(), "{label} ends at {right} of {}", edge.get());
        }
    }

    #[test]
    fn questions_say_of_a_bake_under_way_that_what_is_known_is_written() {
        for is_under_way in [true, false] {
            let view = ExportView {
                suggested: "room.png",
                baked: [64, 48],
                units: Units::Photometric,
                has_illuminance: false,
                is_under_way,
                marked: None,
                seen: None,
            };
            let (mut options, mut path) = (ExportOptions::default(), String::from("room_####.png"));
            let mut window = Harness::builder().with_size(vec2(600.0, 900.0)).build_ui(|ui| {
                export_ui(ui, &mut path, &mut options, &view, &mut Vec::new());
                ui.push_id("frames", |ui| frames_ui(ui, &mut path, &mut options, &view, (&mut None, 9, 24.0)));
            });
            window.run_steps(4);
            let n_told = window.query_all_by_label_contains("what is known so far is written").count();
            assert_eq!(n_told, 2 * usize::from(is_under_way));
        }
    }
}
