//! The sky: what it is, how it is turned, how bright it is, where its sun stands, and how it comes into a bake.

mod dome;
mod sun;

use clerestory_transport::basis::{LightBasis, SourceKind};
use clerestory_transport::light::{LightRig, luminance};
use clerestory_transport::sky::{DOME_DIVISIONS, SkyLight, SkySetting, SunSetting, SunTime};
use eframe::egui::{Button, CollapsingHeader, ComboBox, Grid, RichText, TextStyle, Ui};
use glam::Vec3;

use super::number::Number;
use crate::action::{Action, FileTask};
use crate::illuminance::lux_words;
use crate::look::sky::{ROTATION_DEG, is_made_anew};
use dome::{DomePicture, dome_ui};
pub use sun::NEW_SUN;
use sun::{sun_of, sun_ui};

/// What the section shows.
pub struct SkyView<'a> {
    /// Columns of what is open.
    pub basis: &'a LightBasis,
    /// Whether there is a scene, so that it can be baked.
    pub can_bake: bool,
    /// Whether a map is being read.
    pub is_reading: bool,
    /// Whether the bake that is shown found that no sky lights anything.
    pub is_shut_out: bool,
}

/// What the section remembers and no look holds.
pub struct SkyState {
    /// The hour that it is while the day plays.
    pub playing: Option<f64>,
    /// A sky that was asked for, whose map is being made; the section shows it already.
    pub wanted: Option<SkySetting>,
    /// Divisions of the patches of the next bake.
    divisions: u32,
    /// Place and moment that were set before the sun was set by angle, and the azimuth of north.
    before: Option<(SunTime, f64)>,
    dome: DomePicture,
}

impl Default for SkyState {
    fn default() -> Self {
        SkyState { playing: None, wanted: None, divisions: 1, before: None, dome: DomePicture::default() }
    }
}

impl SkyState {
    /// Has the dome painted again.
    pub fn forget_picture(&mut self) {
        self.dome = DomePicture::default();
    }
}

/// What a sky is made of.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Kind {
    AsBaked,
    Uniform,
    SunAndSky,
    Picture,
}

impl Kind {
    fn of(sky: &SkySetting) -> Kind {
        match (sky.file.as_deref(), sky.sun) {
            (Some("uniform"), _) => Kind::Uniform,
            (Some(_), _) => Kind::Picture,
            (None, Some(_)) => Kind::SunAndSky,
            (None, None) => Kind::AsBaked,
        }
    }
}

/// Stops that the intensity may be off 1.
const MOST_EV: f32 = 20.0;
/// Width in degrees of a patch of the undivided dome.
const PATCH_DEG: f32 = 12.0;

/// Points of height from which a window has room for the sky beside the list of lights: lower ones begin with it folded away.
const OPEN_FROM: f32 = 800.0;
/// Points of width in which both numbers of the intensity stand side by side, and in which numbers stand beside the dome.
const ROOM_FOR_TWO: f32 = 188.0;
const ROOM_BESIDE: f32 = 300.0;

const SHUT_OUT: &str = "These rooms are closed: no sky lights what is seen";

/// Draws it.
pub fn sky_ui(ui: &mut Ui, view: &SkyView, rig: &mut LightRig, state: &mut SkyState, actions: &mut Vec<Action>) {
    let dome = view.basis.sources.iter().find_map(|source| match source.kind {
        SourceKind::Dome { divisions } => Some((source.key.as_str(), divisions)),
        _ => None,
    });
    let heading = CollapsingHeader::new(RichText::new("Sky").heading().strong()).id_salt("sky section");
    let has_room = ui.ctx().content_rect().height() >= OPEN_FROM;
    heading.default_open(dome.is_some() && has_room).show(ui, |ui| {
        let Some((key, divisions)) = dome else { return missing_ui(ui, view, state, actions) };
        let Some(light) = view.basis.sky_light(rig) else { return };
        let as_baked = view.basis.sky_as_baked();
        let before = rig.sky.clone().unwrap_or_else(|| as_baked.clone());
        let shown = state.wanted.clone().unwrap_or_else(|| before.clone());
        let mut sky = shown.clone();
        kind_ui(ui, view, (&mut sky, &light), actions);
        let content = |ui: &mut Ui| {
            dome_ui(ui, &mut sky, &light, &mut state.dome);
            let is_narrow = ui.available_width() < ROOM_FOR_TWO;
            Grid::new("sky").num_columns(2).spacing([10.0, 5.0]).show(ui, |ui| {
                turn_ui(ui, &mut sky);
                intensity_ui(ui, &mut sky, is_narrow);
                lux_ui(ui, view.basis, rig, (key, &light));
            });
        };
        if ui.available_width() < ROOM_BESIDE {
            ui.vertical(content);
        } else {
            ui.horizontal_top(content);
        }
        sun_ui(ui, &mut sky, (&mut state.playing, &mut state.before));
        columns_ui(ui, view, (&light, divisions), state, actions);
        if sky != shown {
            if is_made_anew(&before, &sky) {
                state.wanted = Some(sky);
            } else {
                // A map that is not made anew is the one that is there.
                let sky = SkySetting { map: before.map, ..sky };
                (rig.sky, state.wanted) = (Some(sky).filter(|sky| *sky != as_baked), None);
            }
        }
    });
}

/// How a scene gets a sky that can be turned.
fn missing_ui(ui: &mut Ui, view: &SkyView, state: &mut SkyState, actions: &mut Vec<Action>) {
    let words = "A sky that can be turned and exchanged needs columns of its own; this bake has none";
    ui.label(RichText::new(words).weak());
    bake_ui(ui, view, ("Bake with sky", "Under the sky of the look, else under sun and clear sky"), state, actions);
}

fn bake_ui(ui: &mut Ui, view: &SkyView, (verb, hint): (&str, &str), state: &mut SkyState, actions: &mut Vec<Action>) {
    ui.horizontal(|ui| {
        let button = ui.add_enabled(view.can_bake, Button::new(verb)).on_hover_text(hint);
        let button = button.on_disabled_hover_text("Open the scene of this bake: it takes the scene to bake it anew");
        if button.clicked() {
            actions.push(Action::BakeWithSky { divisions: state.divisions });
        }
        let words = |divisions: u32| format!("{} patches", 144 * divisions * divisions + 1);
        let combo = ComboBox::from_id_salt("patches").width(104.0).selected_text(words(state.divisions));
        let combo = combo.show_ui(ui, |ui| {
            for divisions in DOME_DIVISIONS {
                ui.selectable_value(&mut state.divisions, divisions, words(divisions));
            }
        });
        let hint =
            "Patches of the sky above the horizon, 12°, 6° or 3° wide: more are sharper, and take longer to bake";
        combo.response.on_hover_text(hint).accessible_name("Patches of the sky");
    });
}

/// What the sky is.
fn kind_ui(ui: &mut Ui, view: &SkyView, (sky, light): (&mut SkySetting, &SkyLight), actions: &mut Vec<Action>) {
    let kind = Kind::of(sky);
    let name = |name: &str| name.rsplit(['/', '\\']).next().unwrap_or(name).to_owned();
    let baked = view.basis.sky.as_ref().map_or("the sky of the bake", |sky| sky.name.as_str());
    let text = match kind {
        Kind::AsBaked => "As baked".to_owned(),
        Kind::Uniform => "Uniform".to_owned(),
        Kind::SunAndSky => "Sun and clear sky".to_owned(),
        Kind::Picture => name(&light.name),
    };
    ui.horizontal(|ui| {
        let combo = ComboBox::from_id_salt("kind of sky").width(190.0).truncate().selected_text(text);
        let combo = combo.show_ui(ui, |ui| {
            let choice = |ui: &mut Ui, of: Kind, words: &str, hint: &str| {
                ui.selectable_label(kind == of, words).on_hover_text(hint).clicked() && kind != of
            };
            let own = SkySetting { rotation_deg: sky.rotation_deg, intensity: sky.intensity, ..SkySetting::default() };
            if choice(ui, Kind::AsBaked, "As baked", &name(baked)) {
                *sky = own.clone();
            }
            if choice(ui, Kind::Uniform, "Uniform", "1 cd/m² from everywhere, before its intensity") {
                *sky = SkySetting { file: Some("uniform".into()), ..own.clone() };
            }
            if choice(ui, Kind::SunAndSky, "Sun and clear sky", "Daylight by angles or by date and place, in lux") {
                *sky = SkySetting { sun: Some(sun_of(light)), ..own };
            }
            let open = ui.button("Picture…").on_hover_text("An equirectangular .hdr or .exr; it can be dropped, too");
            if open.clicked() {
                actions.push(Action::Ask(FileTask::OpenSky));
                ui.close();
            }
            let without = ui.add_enabled(view.can_bake, Button::new("Without a sky"));
            let without = without.on_hover_text("The scene is baked again without columns for it");
            if without.on_disabled_hover_text("Open the scene of this bake first").clicked() {
                actions.push(Action::BakeWithoutSky);
                ui.close();
            }
        });
        combo.response.on_hover_text(light.name.as_str()).accessible_name("Kind of sky");
        if view.is_reading {
            ui.spinner();
            ui.label(RichText::new("Reading").weak());
        }
        if matches!(kind, Kind::Uniform | Kind::Picture) {
            let mut has_sun = sky.sun.is_some();
            if ui.checkbox(&mut has_sun, "Sun").on_hover_text("A sun beside the map").changed() {
                sky.sun = has_sun.then(|| SunSetting { intensity: 1.0, ..sun_of(light) });
            }
        }
    });
}

fn turn_ui(ui: &mut Ui, sky: &mut SkySetting) {
    ui.label("Turn");
    let number = Number::new(&mut sky.rotation_deg).range(ROTATION_DEG).speed(0.5).max_decimals(1).suffix("°");
    let hint = "Turns map and sun counter-clockwise, seen from above, degrees";
    if ui.add(number).on_hover_text(hint).accessible_name("Turn of the sky").changed() {
        sky.rotation_deg = (sky.rotation_deg + 180.0).rem_euclid(360.0) - 180.0;
    }
    ui.end_row();
}

/// As a factor and in stops, below each other where there is little room.
fn intensity_ui(ui: &mut Ui, sky: &mut SkySetting, is_narrow: bool) {
    ui.label("Intensity");
    if is_narrow {
        factor_ui(ui, sky);
        ui.end_row();
        ui.label("");
        stops_ui(ui, sky);
    } else {
        ui.horizontal(|ui| {
            factor_ui(ui, sky);
            stops_ui(ui, sky);
        });
    }
    ui.end_row();
}

fn factor_ui(ui: &mut Ui, sky: &mut SkySetting) {
    let speed = (0.01 * f64::from(sky.intensity)).max(1e-4);
    let number = Number::new(&mut sky.intensity).range(0.0..=1e9).speed(speed).max_decimals(4).suffix("×");
    ui.add(number).on_hover_text("Multiplies map and sun").accessible_name("Intensity of the sky");
}

fn stops_ui(ui: &mut Ui, sky: &mut SkySetting) {
    let before = sky.intensity.max(f32::MIN_POSITIVE).log2().clamp(-MOST_EV, MOST_EV);
    let mut stops = before;
    let number = Number::new(&mut stops).range(-MOST_EV..=MOST_EV).speed(0.02).max_decimals(2).suffix(" EV");
    let number = ui.add(number).on_hover_text("The same in stops").accessible_name("Intensity of the sky in EV");
    if number.changed() && stops != before {
        sky.intensity = stops.exp2();
    }
}

/// What the sky sends to level ground, as the lights are set.
fn lux_ui(ui: &mut Ui, basis: &LightBasis, rig: &LightRig, (key, light): (&str, &SkyLight)) {
    let factor = |key: &str| luminance(rig.setting(key).emission(Vec3::ONE, 1.0));
    let sun_key = basis.sources.iter().find(|source| matches!(source.kind, SourceKind::Sun { .. }));
    let of_sun = sun_key.map_or(key, |source| source.key.as_str());
    let [sky, sun] = light.level_lx();
    let rows = [("Sky", sky * factor(key)), ("Sun", sun * factor(of_sun))];
    for (name, lux) in rows.into_iter().filter(|(name, _)| *name == "Sky" || light.sun.is_some()) {
        ui.label(name);
        ui.label(format!("{} lx", lux_words(f64::from(lux)))).on_hover_text("On level ground that sees all of the sky");
        ui.end_row();
    }
}

/// How the sun shines, and a bake that makes it sharp.
fn columns_ui(
    ui: &mut Ui,
    view: &SkyView,
    (light, divisions): (&SkyLight, u32),
    state: &mut SkyState,
    actions: &mut Vec<Action>,
) {
    let width = PATCH_DEG / divisions as f32;
    let soft = format!(
        "This sun has no column of its own: it shines from its patch of the sky, {width:.0}° wide, with soft shadows. \
         Bake it for sharp ones"
    );
    let words = match light.sun {
        _ if view.is_shut_out => SHUT_OUT.into(),
        None => format!("Patches of the sky are {width:.0}° wide"),
        Some(_) if view.basis.keeps_its_sun(light) => "This sun has its own column, and sharp shadows".into(),
        Some(_) => soft.clone(),
    };
    // The room of the longest words, so that nothing moves under the pointer that drags the sun.
    let font = TextStyle::Small.resolve(ui.style());
    let longest = ui.painter().layout(soft, font, ui.visuals().weak_text_color(), ui.available_width());
    ui.scope(|ui| {
        ui.set_min_height(longest.rect.height());
        ui.label(RichText::new(words).weak().small());
    });
    bake_ui(ui, view, ("Bake this sky", "The same scene with columns for this sun and these patches"), state, actions);
}
