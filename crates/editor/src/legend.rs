//! The legend of a false-color picture: a bar of colors with values and a unit, drawn into files and beside the picture.

use clerestory_relight::display::{ColorScale, DisplayParams, turbo_bytes};
use eframe::egui::{self, Align2, Color32, FontId, Rect, Ui, Vec2, pos2, vec2};
use image::{Rgb, RgbImage};
use serde_json::{Value, json};

use crate::isolux::Isolux;
use crate::lettering::Lettering;
use crate::look::{Display, Quantity, Units};

/// What the colors of a picture mean.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Legend {
    /// What is shown.
    pub quantity: Quantity,
    /// Which value has which color.
    pub scale: ColorScale,
    /// Lines of equal value over it.
    pub isolux: Isolux,
    /// What its numbers count.
    pub units: Units,
}

/// Background in a file: that of the window around the picture.
pub const PAPER: Rgb<u8> = Rgb([18, 18, 18]);
/// Words on it.
pub const INK: Rgb<u8> = Rgb([230, 230, 230]);
/// Pixels around and between, width of the bar, of its marks, and size of letters, at a scale of one.
const GAP: u32 = 4;
const BAR: u32 = 8;
const MARK: u32 = 2;
const LETTER: u32 = 11;
/// Least height of a legend, so that two values fit.
const LEAST_HEIGHT: u32 = 48;
/// Points of an area of the window in which a scale has its usual size, and what it takes there and in a smaller one at most.
const USUAL_AREA: Vec2 = vec2(480.0, 340.0);
const USUAL_SIZE: Vec2 = vec2(98.0, 260.0);
const SMALL_SIZE: Vec2 = vec2(70.0, 140.0);
/// Rows of a picture for which letters have their least size; twice as many, twice the size.
const ROWS_PER_SCALE: u32 = 360;

/// How many times larger than the least letters and lines are in a picture of so many rows.
pub fn scale_of(rows: u32) -> u32 {
    (rows / ROWS_PER_SCALE).max(1)
}

impl Legend {
    /// Of a picture that is shown like this; none where its colors are its own.
    pub fn of(display: &Display, shown: &DisplayParams, units: Units) -> Option<Legend> {
        let (quantity, scale) = display.quantity().zip(shown.false_color)?;
        Some(Legend { quantity, scale, isolux: display.isolux(), units })
    }

    /// Symbol of the unit, or a word for what has none.
    pub fn unit(&self) -> &'static str {
        self.quantity.unit_in(self.units)
    }

    /// For people and programs.
    pub fn json(&self) -> Value {
        // As short as an f32 allows.
        let number = |value: f32| value.to_string().parse::<f64>().unwrap_or(f64::from(value));
        json!({
            "quantity": self.quantity.name(), "unit": self.unit(), "spacing": self.scale.spacing,
            "low": number(self.scale.low), "high": number(self.scale.high), "isolux": self.isolux.name(),
        })
    }

    /// Sets the legend beside a picture of RGB bytes, on its right, so that nothing of it is covered.
    pub fn beside(&self, picture: &RgbImage) -> RgbImage {
        let scale = scale_of(picture.height());
        let mut letters = Lettering::new((LETTER * scale) as f32);
        let unit = self.unit();
        let [unit_width, line] = letters.size(unit);
        let height = picture.height().max(LEAST_HEIGHT);
        let (top, bottom) = (2 * GAP * scale + line, height - GAP * scale - line / 2);
        let bar = self.bar();
        let marks = bar.marks(((bottom - top) / line + 1) as usize);
        let longest = marks.iter().map(|(_, words)| letters.size(words)[0]).max().unwrap_or(0);
        let text = ((BAR + MARK + GAP / 2) * scale + longest).max(unit_width);

        let left = picture.width() + GAP * scale;
        let mut sheet = RgbImage::from_pixel(left + text + GAP * scale, height, PAPER);
        image::imageops::replace(&mut sheet, picture, 0, 0);
        letters.write(&mut sheet, unit, [left, GAP * scale / 2], INK);
        for y in top..=bottom {
            let color = Rgb(turbo_bytes((bottom - y) as f32 / (bottom - top) as f32));
            (left..left + BAR * scale).for_each(|x| sheet.put_pixel(x, y, color));
        }
        for (place, words) in marks {
            let y = bottom - (place * (bottom - top) as f32).round() as u32;
            let right = left + BAR * scale;
            (right..right + MARK * scale).for_each(|x| sheet.put_pixel(x, y, INK));
            letters.write(&mut sheet, &words, [right + (MARK + GAP / 2) * scale, y - line / 2], INK);
        }
        sheet
    }

    /// Draws it into a corner of an area of the window.
    pub fn ui(&self, ui: &Ui, area: Rect, corner: Corner) {
        self.bar().ui(ui, area, corner);
    }

    fn bar(&self) -> ScaleBar {
        let (name, unit) = (self.quantity.name(), self.unit());
        ScaleBar { name, unit, scale: self.scale, counting: Counting::Up }
    }
}

/// A bar of colors with values, in the window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleBar {
    /// What is shown.
    pub name: &'static str,
    /// Its unit.
    pub unit: &'static str,
    /// Which value has which color.
    pub scale: ColorScale,
    /// How its values are told.
    pub counting: Counting,
}

/// Where a scale is drawn in an area.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Corner {
    /// Below on the left.
    Left,
    /// Below on the right.
    Right,
}

/// How values of a scale are told.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Counting {
    /// As they are.
    Up,
    /// By how far they lie below 0: decibels below a peak, the greatest error with the last color.
    Down,
}

impl Counting {
    /// What a told number is on the scale, and the other way round.
    pub fn turned(self, value: f32) -> f32 {
        if self == Counting::Up { value } else { -value }
    }
}

impl ScaleBar {
    /// The words for a value of the scale.
    fn words(&self, value: f32) -> String {
        number_words(self.counting.turned(value))
    }

    /// Values with a mark and their words, at most `most`.
    fn marks(&self, most: usize) -> Vec<(f32, String)> {
        self.scale.ticks(most).into_iter().map(|value| (self.scale.position(value), self.words(value))).collect()
    }

    /// Draws it into a corner of an area, which has one scale there at most.
    pub fn ui(&self, ui: &Ui, area: Rect, corner: Corner) {
        let is_small = area.width() < USUAL_AREA.x || area.height() < USUAL_AREA.y;
        let (most, letters) = if is_small { (SMALL_SIZE, 10.0) } else { (USUAL_SIZE, 12.0) };
        let size = vec2(most.x, (area.height() - 40.0).clamp(60.0, most.y));
        let align = if corner == Corner::Left { Align2::LEFT_BOTTOM } else { Align2::RIGHT_BOTTOM };
        let place = align.align_size_within_rect(size, area.shrink(12.0));
        let response = ui.interact(place, ui.scope_id().with(("legend", corner)), egui::Sense::hover());
        let (low, high, unit) = (self.words(self.scale.low), self.words(self.scale.high), self.unit);
        let words = format!("Scale of {} from {low} to {high} {unit}", self.name.to_lowercase());
        response.widget_info(|| egui::WidgetInfo::labeled(egui::Role::Image, true, &words));

        let painter = ui.painter_at(area);
        painter.rect_filled(place, 4.0, Color32::from_black_alpha(190));
        let (font, ink) = (FontId::proportional(letters), Color32::from_gray(230));
        painter.text(place.left_top() + vec2(8.0, 6.0), Align2::LEFT_TOP, unit, font.clone(), ink);
        let bar = Rect::from_min_max(
            place.left_top() + vec2(8.0, 28.0),
            pos2(place.left() + 0.25 * most.x, place.bottom() - 10.0),
        );
        for y in 0..bar.height() as u32 {
            let [r, g, b] = turbo_bytes(1.0 - y as f32 / bar.height());
            let row = Rect::from_min_size(bar.left_top() + vec2(0.0, y as f32), vec2(bar.width(), 1.5));
            painter.rect_filled(row, 0.0, Color32::from_rgb(r, g, b));
        }
        for (position, words) in self.marks((bar.height() / 16.0) as usize + 1) {
            let y = bar.bottom() - position * bar.height();
            painter.hline(bar.right()..=bar.right() + 4.0, y, (1.0, ink));
            painter.text(pos2(bar.right() + 7.0, y), Align2::LEFT_CENTER, words, font.clone(), ink);
        }
    }
}

/// A number with three digits at most, without zeros that say nothing.
pub fn number_words(value: f32) -> String {
    if value == 0.0 {
        return "0".into();
    }
    let decade = value.abs().max(f32::MIN_POSITIVE).log10().floor();
    if !(-3.0..6.0).contains(&decade) {
        return format!("{value:.2e}").replace(".00e", "e").replace("0e", "e");
    }
    let digits = (2.0 - decade).clamp(0.0, 5.0) as usize;
    let words = format!("{value:.digits$}");
    if words.contains('.') { words.trim_end_matches('0').trim_end_matches('.').into() } else { words }
}

#[cfg(test)]
mod tests {
    use super::*;
    use clerestory_relight::display::Spacing;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    fn legend() -> Legend {
        let scale = ColorScale { spacing: Spacing::Log, low: 1.0, high: 1000.0 };
        Legend { quantity: Quantity::Luminance, scale, isolux: Isolux::Off, units: Units::Photometric }
    }

    #[test]
    fn the_picture_stays_and_the_bar_runs_from_low_to_high() {
        let picture = RgbImage::from_fn(40, 90, |x, y| Rgb([x as u8, y as u8, 7]));
        let sheet = legend().beside(&picture);
        assert!(sheet.width() > 60 && sheet.height() == 90);
        assert_eq!(image::imageops::crop_imm(&sheet, 0, 0, 40, 90).to_image(), picture);
        let column: Vec<[u8; 3]> = (0..90).map(|y| sheet.get_pixel(40 + GAP + 1, y).0).collect();
        let top = column.iter().position(|rgb| *rgb == turbo_bytes(1.0)).unwrap();
        let bottom = column.iter().rposition(|rgb| *rgb == turbo_bytes(0.0)).unwrap();
        let middle = column[(top + bottom) / 2];
        let near = |a: [u8; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| a.abs_diff(b) < 12);
        assert!(top < bottom && near(middle, turbo_bytes(0.5)), "{top} {bottom} {middle:?}");
    }

    #[test]
    fn a_legend_fits_beside_a_picture_of_any_size() {
        for (width, height) in [(1, 1), (8, 48), (64, 47), (300, 2000)] {
            let sheet = legend().beside(&RgbImage::new(width, height));
            assert!(sheet.height() == height.max(LEAST_HEIGHT) && sheet.width() > width + BAR);
        }
    }

    #[test]
    fn a_legend_leaves_most_of_a_small_picture_free() {
        for (width, height) in [(200.0, 420.0), (420.0, 200.0), (600.0, 400.0), (1400.0, 900.0)] {
            let size = vec2(width, height);
            let mut window = Harness::builder().with_size(size).build_ui(|ui| {
                legend().ui(ui, Rect::from_min_size(pos2(0.0, 0.0), size), Corner::Right);
            });
            window.run_steps(2);
            let covered = window.get_by_label_contains("Scale of luminance").rect();
            let share = covered.area() / (width * height);
            assert!(share < 0.13 && covered.height() >= 60.0, "{width} × {height}: {share}");
        }
    }

    #[test]
    fn numbers_are_short() {
        let cases = [
            (0.0, "0"),
            (-0.0, "0"),
            (1000.0, "1000"),
            (0.05, "0.05"),
            (2.5, "2.5"),
            (0.1 + 0.2, "0.3"),
            (5e6, "5e6"),
            (2e-4, "2e-4"),
        ];
        for (value, words) in cases {
            assert_eq!(number_words(value), words);
        }
    }
}
