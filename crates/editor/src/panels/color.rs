//! The color of a light: as the file has it, any color, or a color temperature.

use clerestory_transport::light::planckian_tint;
use eframe::egui::{
    self, Color32, ColorImage, Popup, PopupCloseBehavior, Rect, Response, Sense, Slider, SliderClamping, Stroke,
    StrokeKind, TextureOptions, Ui, Vec2,
    ecolor::{Hsva, HsvaGamma},
    pos2, vec2,
};
use glam::Vec3;

use super::arrows::{FINE, arrows};
use super::number::{Number, Spelling, beside, number_of, slider_ui};
use crate::theme;

/// How a light is tinted.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Tint {
    /// Linear Rec. 709; replaces the file's color.
    pub color: Option<[f32; 3]>,
    /// Replaces the color by that of a black body.
    pub kelvin: Option<f32>,
}

/// Color temperatures with a name.
const KELVINS: [(&str, f32); 5] =
    [("Candle", 1900.0), ("Warm", 2700.0), ("White", 4000.0), ("Daylight", 6500.0), ("Shade", 8000.0)];
/// What a light has at first when it is given one.
const NEW_KELVIN: f32 = 3000.0;
/// Those that a look may have.
const KELVIN_RANGE: std::ops::RangeInclusive<f32> = 500.0..=100_000.0;
/// Fewer with a k behind them are thousands.
const MOST_THOUSANDS: f64 = 100.0;
const PICKER_WIDTH: f32 = 252.0;
/// How far an arrow key moves the mark of a picker, in sides of it.
const KEY_STEP: f32 = 0.02;
const N: usize = 32;

/// A swatch that opens the editor; answers whether the tint was set, be it to what it is. `file_color` is linear. Without
/// `kelvin_choice` (spots) there is no color temperature to choose.
pub fn tint_ui(ui: &mut Ui, label: &str, tint: &mut Tint, file_color: Vec3, kelvin_choice: KelvinChoice) -> bool {
    let shown = match *tint {
        Tint { kelvin: Some(kelvin), .. } => planckian_tint(kelvin),
        Tint { color: Some(color), .. } => Vec3::from(color),
        Tint { .. } => file_color,
    };
    let response = swatch(ui, swatch_color(shown), *tint != Tint::default()).accessible_name(format!("{label} color"));
    let popup = Popup::menu(&response).close_behavior(PopupCloseBehavior::CloseOnClickOutside);
    let set = popup.show(|ui| {
        ui.set_width(PICKER_WIDTH);
        ui.spacing_mut().button_padding = vec2(6.0, 2.0);
        let is_chosen = mode_ui(ui, tint, shown, kelvin_choice);
        let is_edited = match *tint {
            Tint { kelvin: Some(kelvin), .. } => kelvin_ui(ui, label, kelvin, tint),
            Tint { color: Some(color), .. } => {
                // Both at every frame, so that nothing moves under the pointer that picks.
                let (picked, typed) = (picker_ui(ui, color), hex_ui(ui, label, color));
                let edited = picked.or(typed);
                tint.color = edited.or(Some(color));
                edited.is_some()
            }
            Tint { .. } => {
                let words = match kelvin_choice {
                    KelvinChoice::OfferedOnWhite => "White, luminance alone",
                    _ => "The color that the scene gives it",
                };
                ui.label(egui::RichText::new(words).weak());
                false
            }
        };
        is_chosen || is_edited
    });
    set.is_some_and(|set| set.inner)
}

/// Whether a color temperature can be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KelvinChoice {
    /// It can.
    Offered,
    /// It can; what is not tinted is white.
    OfferedOnWhite,
    /// Only colors.
    Hidden,
}

/// Answers whether one was chosen, be it the one that is on.
fn mode_ui(ui: &mut Ui, tint: &mut Tint, shown: Vec3, kelvin_choice: KelvinChoice) -> bool {
    let mut is_chosen = false;
    ui.horizontal(|ui| {
        let mut chosen = |ui: &mut Ui, is_on: bool, words: &str| {
            let is_clicked = ui.selectable_label(is_on, words).clicked();
            is_chosen |= is_clicked;
            is_clicked && !is_on
        };
        let untinted = if kelvin_choice == KelvinChoice::OfferedOnWhite { "White" } else { "From file" };
        if chosen(ui, *tint == Tint::default(), untinted) {
            *tint = Tint::default();
        }
        if chosen(ui, tint.color.is_some() && tint.kelvin.is_none(), "Color") {
            // As bright as it was, as far as a color goes.
            let color = tint.color.unwrap_or((shown / shown.max_element().max(1.0)).to_array());
            *tint = Tint { color: Some(color), kelvin: None };
        }
        if kelvin_choice != KelvinChoice::Hidden && chosen(ui, tint.kelvin.is_some(), "Kelvin") {
            tint.kelvin = Some(NEW_KELVIN);
        }
    });
    ui.add_space(4.0);
    is_chosen
}

/// The slider ends where lamps do; what lies beyond stays, and can be typed. Answers whether it was set.
fn kelvin_ui(ui: &mut Ui, label: &str, mut kelvin: f32, tint: &mut Tint) -> bool {
    ui.spacing_mut().slider_width = PICKER_WIDTH - 84.0;
    let slider = Slider::new(&mut kelvin, 1700.0..=12_000.0)
        .clamping(SliderClamping::Never)
        .logarithmic(true)
        .fixed_decimals(0)
        .suffix(" K")
        .trailing_fill(false);
    let response = slider_ui(ui, slider, Spelling::new(|kelvin, _| format!("{kelvin:.0}"), kelvins));
    let response =
        response.on_hover_text("Color temperature in kelvin: 2700 K is warm, 6500 K is daylight\nThe lumen stay");
    let mut is_set = response.accessible_name(format!("{label} kelvin")).changed();
    if is_set {
        tint.kelvin = Some(kelvin.clamp(*KELVIN_RANGE.start(), *KELVIN_RANGE.end()));
    }
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 2.0;
        ui.spacing_mut().button_padding.x = 4.0;
        for (name, kelvin) in KELVINS {
            if ui.small_button(name).on_hover_text(format!("{kelvin:.0} K")).clicked() {
                (tint.kelvin, is_set) = (Some(kelvin), true);
            }
        }
    });
    is_set
}

/// Kelvin as they are typed, with their unit or without; so few of them with a k are thousands.
fn kelvins(text: &str) -> Option<f64> {
    let text = text.trim();
    let digits = text.trim_end_matches(['K', 'k', ' ']);
    let kelvin = number_of(digits, "")?;
    let is_thousands = digits.len() < text.len() && kelvin < MOST_THOUSANDS;
    Some(if is_thousands { 1000.0 * kelvin } else { kelvin })
}

/// The color temperature as a number, to drag and to type; a light without one takes it on once it is changed. Answers
/// whether it was.
pub fn kelvin_field_ui(ui: &mut Ui, label: &str, tint: &mut Tint, is_mixed: bool) -> bool {
    let mut kelvin = f64::from(tint.kelvin.unwrap_or(NEW_KELVIN));
    let has_one = tint.kelvin.is_some();
    if is_mixed || !has_one {
        kelvin = beside(kelvin, f64::from(*KELVIN_RANGE.start()));
    }
    let number = Number::new(&mut kelvin).range(KELVIN_RANGE).speed(15.0);
    // A word has no unit.
    let number = number.suffix(if is_mixed { "" } else { " K" });
    let number = number.words(|kelvin, _| match (is_mixed, has_one) {
        (true, _) => "mixed".into(),
        (false, true) => format!("{kelvin:.0}"),
        (false, false) => "–".into(),
    });
    let number = number.read(kelvins);
    let field = ui.add_sized([66.0, 22.0], number).on_hover_text("Color temperature, kelvin");
    let is_set = field.accessible_name(format!("{label} color temperature")).changed();
    if is_set {
        *tint = Tint { color: None, kelvin: Some(kelvin as f32) };
    }
    is_set
}

fn swatch(ui: &mut Ui, color: Color32, is_changed: bool) -> Response {
    let (rect, response) = ui.allocate_exact_size(vec2(28.0, 22.0), Sense::click());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::ColorWell, ui.is_enabled(), "Color"));
    if ui.is_rect_visible(rect) {
        let stroke = if is_changed || response.hovered() {
            Stroke::new(1.5, ui.visuals().strong_text_color())
        } else {
            Stroke::new(1.0, ui.visuals().weak_text_color())
        };
        ui.painter().rect(rect.shrink2(vec2(0.0, 2.0)), 4.0, color, stroke, StrokeKind::Inside);
        theme::keyboard_frame(ui, &response);
    }
    response.on_hover_text(if is_changed { "Color, another one than in the file" } else { "Color" })
}

/// sRGB of a linear color, as bright as can be shown.
pub(crate) fn swatch_color(linear: Vec3) -> Color32 {
    let [r, g, b] = (linear / linear.max_element().max(1e-6)).to_array();
    egui::Rgba::from_rgb(r, g, b).into()
}

/// Square of saturation and value over a bar of hues; answers with the new color if it was moved. The hue of a gray,
/// which its color does not tell, is remembered while the picker is open.
fn picker_ui(ui: &mut Ui, linear: [f32; 3]) -> Option<[f32; 3]> {
    let id = ui.scope_id().with("picked");
    let remembered: Option<([f32; 3], HsvaGamma)> = ui.data(|data| data.get_temp(id));
    let mut hsv = match remembered {
        Some((color, hsv)) if color == linear => hsv,
        _ => HsvaGamma::from(Hsva::from_rgb(linear.map(|v| v.clamp(0.0, 1.0)))),
    };
    let square = field(ui, "Saturation and value", PICKER_WIDTH * 0.62, |s, v| HsvaGamma { s, v, ..hsv });
    let mut moved = false;
    let words = |[s, v]: [f32; 2]| format!("Saturation {:.0} %, value {:.0} %", 100.0 * s, 100.0 * v);
    if let Some([s, v]) = square.moved(ui, [hsv.s, hsv.v], words) {
        (hsv.s, hsv.v, moved) = (s, v, true);
    }
    let bar = field(ui, "Hue", 16.0, |h, _| HsvaGamma { h, s: 1.0, v: 1.0, a: 1.0 });
    let words = |[h, _]: [f32; 2]| format!("{:.0}°", 360.0 * h);
    if let Some([h, _]) = bar.moved(ui, [hsv.h, 0.5], words).filter(|[h, _]| *h != hsv.h) {
        (hsv.h, moved) = (h, true);
    }
    let color = if moved { Hsva::from(hsv).to_rgb() } else { linear };
    ui.data_mut(|data| data.insert_temp(id, (color, hsv)));
    moved.then_some(color)
}

/// The color as six digits, for keys and for what comes from elsewhere; answers with the new color if another was typed.
fn hex_ui(ui: &mut Ui, label: &str, linear: [f32; 3]) -> Option<[f32; 3]> {
    let id = ui.scope_id().with("hex");
    let [r, g, b, _] = swatch_color(Vec3::from(linear)).to_array();
    let mut text = ui.data(|data| data.get_temp(id)).unwrap_or_else(|| format!("#{r:02X}{g:02X}{b:02X}"));
    let field = ui.horizontal(|ui| {
        ui.label(egui::RichText::new("Hex").weak());
        ui.add(egui::TextEdit::singleline(&mut text).desired_width(76.0)).on_hover_text("sRGB, as in #FFD2A1")
    });
    let field = field.inner.accessible_name(format!("{label} hex"));
    let typed = if field.changed() { from_hex(&text) } else { None };
    // What is being typed stays, whatever it is.
    let has_focus = field.has_focus();
    ui.data_mut(|data| match has_focus {
        true => _ = data.insert_temp(id, text),
        false => _ = data.remove_temp::<String>(id),
    });
    typed
}

/// Linear color of six digits.
fn from_hex(text: &str) -> Option<[f32; 3]> {
    let digits = text.trim().trim_start_matches('#');
    let color = Color32::from_hex(&format!("#{digits}")).ok().filter(|_| digits.len() == 6)?;
    let [r, g, b, _] = egui::Rgba::from(color).to_array();
    Some([r, g, b])
}

/// A rectangle of colors.
struct Field(Response);

fn field(ui: &mut Ui, name: &str, height: f32, color: impl Fn(f32, f32) -> HsvaGamma) -> Field {
    let (rect, response) = ui.allocate_exact_size(vec2(PICKER_WIDTH, height), Sense::click_and_drag());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Slider, ui.is_enabled(), name));
    let pixels = (0..N * N).map(|i| {
        let at = |i: usize| i as f32 / (N - 1) as f32;
        Color32::from(color(at(i % N), 1.0 - at(i / N)))
    });
    let image = ColorImage::new([N, N], pixels.collect());
    let texture = ui.ctx().load_texture_cached(name, response.id, image, TextureOptions::LINEAR);
    ui.painter().image(texture.id(), rect, Rect::from_min_max(pos2(0.0, 0.0), pos2(1.0, 1.0)), Color32::WHITE);
    Field(response)
}

impl Field {
    /// Draws the mark, and answers where it was dragged or taken by arrow keys: 0…1 to the right and up. `words` tell a place to those
    /// who do not see it.
    fn moved(&self, ui: &Ui, at: [f32; 2], words: impl Fn([f32; 2]) -> String) -> Option<[f32; 2]> {
        let rect = self.0.rect;
        let dragged = self.0.interact_pointer_pos().map(|p| {
            let to = (p - rect.min) / rect.size();
            [to.x.clamp(0.0, 1.0), 1.0 - to.y.clamp(0.0, 1.0)]
        });
        let step = arrows(ui, &self.0, FINE) * KEY_STEP;
        let stepped = [(at[0] + step.x).clamp(0.0, 1.0), (at[1] - step.y).clamp(0.0, 1.0)];
        let moved = dragged.or((step != Vec2::ZERO).then_some(stepped));
        theme::keyboard_frame(ui, &self.0);
        let [x, y] = moved.unwrap_or(at);
        ui.ctx().accesskit_node_builder(self.0.id, |node| node.set_value(words([x, y])));
        let center = rect.min + vec2(x, 1.0 - y) * rect.size();
        ui.painter().circle_stroke(center, 6.0, Stroke::new(3.0, Color32::from_black_alpha(160)));
        ui.painter().circle_stroke(center, 6.0, Stroke::new(1.5, Color32::WHITE));
        moved
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn six_digits_are_a_color_and_nothing_else_is() {
        assert_eq!(from_hex(" #FF0000"), Some([1.0, 0.0, 0.0]));
        let [gray, ..] = from_hex("808080").unwrap();
        assert!((gray - 0.2159).abs() < 1e-3, "{gray}");
        assert_eq!(["", "#FFF", "#GG0000", "#FF00000", "red"].map(from_hex), [None; 5]);
    }

    #[test]
    fn kelvin_are_typed_in_thousands_too() {
        assert_eq!(
            ["2700", " 2700 K", "2700k", "2.7k", "2,7k", "3 kK", "100"].map(kelvins),
            [2700.0, 2700.0, 2700.0, 2700.0, 2700.0, 3000.0, 100.0].map(Some)
        );
        assert_eq!(["", "K", "warm", "2,700k", "nan"].map(kelvins), [None; 5]);
    }

    #[test]
    fn a_swatch_shows_the_hue_of_lamps_of_any_brightness() {
        assert_eq!(swatch_color(Vec3::new(40.0, 0.0, 0.0)), Color32::from_rgb(255, 0, 0));
        assert_eq!(swatch_color(Vec3::ZERO), Color32::from_rgb(0, 0, 0));
    }
}
