//! How the window looks: calm grays that do not tint the eye, one warm accent.

use eframe::egui::{self, Color32, CornerRadius, FontId, Margin, Stroke, TextStyle, Theme, Visuals};

/// Warm accent: what is lit, selected or soloed.
pub const ACCENT: Color32 = Color32::from_rgb(232, 170, 84);
/// Muted lamps and things that went wrong.
pub const ALERT: Color32 = Color32::from_rgb(214, 96, 88);
/// Text on top of [`ACCENT`] and [`ALERT`].
pub const ON_ACCENT: Color32 = Color32::from_rgb(24, 18, 10);

/// Neutral gray around the picture, the same in both themes: a colored or bright surround would change what is judged.
pub const SURROUND: Color32 = Color32::from_gray(18);

/// Gives both themes their colors, sizes and spacing.
pub fn apply(ctx: &egui::Context) {
    ctx.set_visuals_of(Theme::Dark, dark());
    ctx.set_visuals_of(Theme::Light, light());
    ctx.all_styles_mut(|style| {
        style.text_styles.insert(TextStyle::Body, FontId::proportional(13.5));
        style.text_styles.insert(TextStyle::Button, FontId::proportional(13.5));
        style.text_styles.insert(TextStyle::Small, FontId::proportional(11.5));
        style.text_styles.insert(TextStyle::Heading, FontId::proportional(15.0));
        style.spacing.item_spacing = egui::vec2(7.0, 6.0);
        style.spacing.button_padding = egui::vec2(9.0, 4.0);
        style.spacing.interact_size.y = 22.0;
        style.spacing.window_margin = Margin::same(14);
        style.spacing.menu_margin = Margin::same(8);
        style.spacing.slider_rail_height = 4.0;
        style.animation_time = 0.08;
        // What does not fit shows that it goes on.
        style.spacing.scroll =
            egui::style::ScrollStyle { dormant_background_opacity: 0.0, ..egui::style::ScrollStyle::thin() };
    });
}

/// Dots of the sign that something is on its way, and how many of them it goes on in a second.
const DOTS: u32 = 10;
const STEPS_PER_SEC: f64 = 10.0;

/// A sign that something is on its way. It goes on in steps: a window that is drawn for it without a pause takes the time of what it
/// waits for.
pub fn busy(ui: &mut egui::Ui, side: f32) {
    let (rect, response) = ui.allocate_exact_size(egui::Vec2::splat(side), egui::Sense::hover());
    response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::ProgressIndicator, true, "Working"));
    let step = ui.input(|input| (input.time * STEPS_PER_SEC) as u64 % u64::from(DOTS)) as u32;
    ui.ctx().request_repaint_after(std::time::Duration::from_secs_f64(1.0 / STEPS_PER_SEC));
    for dot in 0..DOTS {
        let (sin, cos) = (std::f32::consts::TAU * dot as f32 / DOTS as f32).sin_cos();
        let at = rect.center() + 0.4 * side * egui::vec2(sin, -cos);
        let behind = (step + DOTS - dot) % DOTS;
        let strength = (1.0 - behind as f32 / DOTS as f32).max(0.15);
        ui.painter().circle_filled(at, 0.08 * side, ACCENT.gamma_multiply(strength));
    }
}

fn dark() -> Visuals {
    let mut v = Visuals::dark();
    let corner = CornerRadius::same(4);
    v.panel_fill = Color32::from_gray(30);
    v.window_fill = Color32::from_gray(36);
    v.window_stroke = Stroke::new(1.0, Color32::from_gray(62));
    v.extreme_bg_color = Color32::from_gray(20);
    v.faint_bg_color = Color32::from_gray(35);
    v.selection.bg_fill = Color32::from_rgb(122, 88, 42);
    v.selection.stroke = Stroke::new(1.0, Color32::from_rgb(255, 232, 200));
    v.weak_text_color = Some(Color32::from_gray(142));
    v.hyperlink_color = ACCENT;
    v.warn_fg_color = ACCENT;
    v.error_fg_color = Color32::from_rgb(226, 110, 102);
    v.slider_trailing_fill = true;
    v.handle_shape = egui::style::HandleShape::Circle;
    v.widgets.noninteractive.bg_stroke = Stroke::new(1.0, Color32::from_gray(46));
    v.widgets.noninteractive.fg_stroke = Stroke::new(1.0, Color32::from_gray(188));
    v.widgets.inactive.weak_bg_fill = Color32::from_gray(46);
    v.widgets.inactive.bg_fill = Color32::from_gray(56);
    v.widgets.inactive.fg_stroke = Stroke::new(1.0, Color32::from_gray(208));
    v.widgets.hovered.weak_bg_fill = Color32::from_gray(58);
    v.widgets.hovered.bg_fill = Color32::from_gray(70);
    v.widgets.hovered.bg_stroke = Stroke::new(1.0, Color32::from_gray(84));
    v.widgets.hovered.fg_stroke = Stroke::new(1.0, Color32::from_gray(240));
    v.widgets.active.bg_stroke = Stroke::new(1.0, ACCENT);
    v.widgets.active.fg_stroke = Stroke::new(1.5, Color32::WHITE);
    for widget in widgets(&mut v) {
        widget.corner_radius = corner;
        widget.expansion = 0.0;
    }
    v
}

fn light() -> Visuals {
    let mut v = Visuals::light();
    v.panel_fill = Color32::from_gray(238);
    v.window_fill = Color32::from_gray(246);
    v.selection.bg_fill = Color32::from_rgb(240, 200, 140);
    v.selection.stroke = Stroke::new(1.0, Color32::from_rgb(74, 46, 8));
    v.weak_text_color = Some(Color32::from_gray(98));
    v.hyperlink_color = Color32::from_rgb(140, 84, 10);
    v.warn_fg_color = Color32::from_rgb(146, 86, 10);
    v.error_fg_color = Color32::from_rgb(178, 50, 42);
    v.slider_trailing_fill = true;
    v.handle_shape = egui::style::HandleShape::Circle;
    v.widgets.noninteractive.fg_stroke = Stroke::new(1.0, Color32::from_gray(58));
    v.widgets.inactive.weak_bg_fill = Color32::from_gray(222);
    v.widgets.inactive.bg_fill = Color32::from_gray(208);
    for widget in widgets(&mut v) {
        widget.corner_radius = CornerRadius::same(4);
        widget.expansion = 0.0;
    }
    v
}

fn widgets(v: &mut Visuals) -> [&mut egui::style::WidgetVisuals; 5] {
    let w = &mut v.widgets;
    [&mut w.noninteractive, &mut w.inactive, &mut w.hovered, &mut w.active, &mut w.open]
}

/// Text in the accent, as dark as it takes to be read on light gray.
pub fn accent_text(ui: &egui::Ui) -> Color32 {
    ui.visuals().hyperlink_color
}

/// Frames a widget of our own while it has the keyboard, as the toolkit's own show it.
pub fn keyboard_frame(ui: &egui::Ui, response: &egui::Response) {
    if response.has_focus() {
        ui.painter().rect_stroke(response.rect, 3.0, Stroke::new(1.5, ACCENT), egui::StrokeKind::Outside);
    }
}

/// Heading of a section, with a thin line under it.
pub fn section(ui: &mut egui::Ui, title: &str) {
    ui.add_space(4.0);
    ui.label(egui::RichText::new(title).heading().strong());
    ui.separator();
}

/// Whether a section is unfolded before anybody touched it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Fold {
    /// Its content is seen.
    Open,
    /// Its title alone is seen.
    Closed,
}

/// A section of the right panel that can be folded away.
pub fn folding(ui: &mut egui::Ui, title: &str, fold: Fold, content: impl FnOnce(&mut egui::Ui)) {
    ui.add_space(2.0);
    let heading = egui::RichText::new(title).heading().strong();
    let header = egui::CollapsingHeader::new(heading).id_salt(title).default_open(fold == Fold::Open);
    header.show_unindented(ui, |ui| {
        ui.add_space(2.0);
        content(ui);
    });
    ui.separator();
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance of an opaque color, 0 to 1.
    fn luminance(color: Color32) -> f32 {
        let [r, g, b, _] = egui::Rgba::from(color).to_array();
        0.2126 * r + 0.7152 * g + 0.0722 * b
    }

    #[test]
    fn words_can_be_read_in_both_themes() {
        for (name, v) in [("dark", dark()), ("light", light())] {
            for ground in [v.panel_fill, v.window_fill] {
                let words = [v.text_color(), v.weak_text_color(), v.hyperlink_color, v.warn_fg_color, v.error_fg_color];
                for (nth, color) in words.into_iter().enumerate() {
                    let (a, b) = (luminance(color), luminance(ground));
                    // As the Web Content Accessibility Guidelines ask of small text.
                    let contrast = (a.max(b) + 0.05) / (a.min(b) + 0.05);
                    assert!(contrast >= 4.5, "{name}, color {nth}: {contrast:.2} on {ground:?}");
                }
            }
        }
    }
}
