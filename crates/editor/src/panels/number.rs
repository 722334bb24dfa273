//! A field for a number: dragged it changes at once, typed it changes once all of it is there.
//!
//! The toolkit's field, which this one wraps, writes at every key. On the way to 1920 that is 1, which a range makes 16, and all that hangs
//! on the number follows; and the text of a number that does not come back to the last bit is exchanged under the cursor.

use std::cell::RefCell;
use std::ops::RangeInclusive;

use eframe::egui::emath::Numeric;
use eframe::egui::{Context, DragValue, Event, Id, ImeEvent, Key, Response, Slider, Ui, Widget};

/// Letters that are told of what cannot be read.
const MOST_TOLD: usize = 24;

type Words<'a> = Box<dyn Fn(f64, RangeInclusive<usize>) -> String + 'a>;
type Read<'a> = Box<dyn Fn(&str) -> Option<f64> + 'a>;

/// The field. Enter, Tab and a press elsewhere take what was typed, Escape gives it up. Digits that nobody typed are no answer: the number
/// behind them may be more exact.
pub struct Number<'a> {
    drag: DragValue<'a>,
    spelling: Spelling<'a>,
}

impl<'a> Number<'a> {
    /// For a value.
    pub fn new(value: &'a mut impl Numeric) -> Number<'a> {
        let drag = DragValue::new(value).update_while_editing(false);
        Number { drag, spelling: Spelling::default() }
    }

    /// What the value may be; one that is outside is brought in.
    pub fn range(self, range: RangeInclusive<impl Numeric>) -> Self {
        Number { drag: self.drag.range(range), ..self }
    }

    /// A value that is outside of its range stays until somebody drags or types.
    pub fn leaves_what_is_outside(self) -> Self {
        Number { drag: self.drag.clamp_existing_to_range(false), ..self }
    }

    /// Change by a drag over one point.
    pub fn speed(self, speed: impl Into<f64>) -> Self {
        Number { drag: self.drag.speed(speed), ..self }
    }

    /// Most digits behind the point.
    pub fn max_decimals(self, n: usize) -> Self {
        Number { drag: self.drag.max_decimals(n), ..self }
    }

    /// Digits behind the point.
    pub fn fixed_decimals(self, n: usize) -> Self {
        Number { drag: self.drag.fixed_decimals(n), ..self }
    }

    /// What stands in front of it.
    pub fn prefix(self, prefix: &str) -> Self {
        Number { drag: self.drag.prefix(prefix.to_owned()), ..self }
    }

    /// Its unit, which may be typed as well.
    pub fn suffix(mut self, suffix: impl Into<String>) -> Self {
        self.spelling.unit = suffix.into();
        Number { drag: self.drag.suffix(self.spelling.unit.clone()), ..self }
    }

    /// How it is written, given the number and the range of digits behind the point.
    pub fn words(mut self, words: impl Fn(f64, RangeInclusive<usize>) -> String + 'a) -> Self {
        self.spelling.words = Some(Box::new(words));
        self
    }

    /// How what was typed is read.
    pub fn read(mut self, read: impl Fn(&str) -> Option<f64> + 'a) -> Self {
        self.spelling.read = Some(Box::new(read));
        self
    }
}

impl Widget for Number<'_> {
    fn ui(self, ui: &mut Ui) -> Response {
        let Number { drag, spelling } = self;
        spelling.typed_ui(ui, |ui, words, read| drag.custom_formatter(words).custom_parser(read).ui(ui))
    }
}

/// Diagonal of a room, m; what is smaller is a model.
const ROOM_M: f64 = 5.0;

/// For a field of meters in a scene of some diagonal: how far a drag over one point goes, `usual_m` in a room, or where nothing is known of
/// it, and less in a model of one; and how many digits behind the point tell that, `fewest` at least.
pub fn step_m(usual_m: f64, fewest: usize, extent_m: Option<f32>) -> (f64, usize) {
    let step_m = usual_m * extent_m.map_or(1.0, |extent_m| (f64::from(extent_m) / ROOM_M).clamp(1e-6, 1.0));
    (step_m, fewest.max((-step_m.log10()).ceil() as usize))
}

/// A slider with a number beside it, which is typed as into the field.
pub fn slider_ui(ui: &mut Ui, slider: Slider<'_>, spelling: Spelling<'_>) -> Response {
    let slider = slider.update_while_editing(false);
    spelling.typed_ui(ui, |ui, words, read| slider.custom_formatter(words).custom_parser(read).ui(ui))
}

/// How a number is written and read.
#[derive(Default)]
pub struct Spelling<'a> {
    unit: String,
    words: Option<Words<'a>>,
    read: Option<Read<'a>>,
}

impl<'a> Spelling<'a> {
    /// In digits; its unit, which stands behind it, may be typed as well.
    pub fn with_unit(unit: &str) -> Spelling<'a> {
        Spelling { unit: unit.to_owned(), ..Spelling::default() }
    }

    /// In words of its own.
    pub fn new(
        words: impl Fn(f64, RangeInclusive<usize>) -> String + 'a,
        read: impl Fn(&str) -> Option<f64> + 'a,
    ) -> Spelling<'a> {
        Spelling { words: Some(Box::new(words)), read: Some(Box::new(read)), ..Spelling::default() }
    }

    /// Has a field drawn that writes and reads like this.
    fn typed_ui(self, ui: &mut Ui, add: impl FnOnce(&mut Ui, Words<'_>, Read<'_>) -> Response) -> Response {
        let id = ui.next_auto_id().with("text");
        let kept: Typed = ui.data_mut(|data| data.remove_temp(id)).unwrap_or_default();
        let is_typed = kept.is_typed || letters_come(ui.ctx());
        let is_given_up = kept.is_given_up || is_given_up(ui.ctx());
        let digits = ui.style().number_formatter.clone();
        let shown = RefCell::new(String::new());
        let words = |number: f64, decimals: RangeInclusive<usize>| {
            let text = match &self.words {
                Some(words) => words(number, decimals),
                None => without_minus(digits.format(number, decimals)),
            };
            shown.replace(text.clone());
            text
        };
        let ctx = ui.ctx().clone();
        let read = |text: &str| {
            let is_left_alone = is_given_up || (!is_typed && *shown.borrow() == text);
            if is_left_alone {
                return None;
            }
            let number = match &self.read {
                Some(read) => read(text),
                None => number_of(text, &self.unit),
            };
            if number.is_none() && !text.trim().is_empty() {
                refuse(&ctx, text);
            }
            number
        };
        let response = add(ui, Box::new(words), Box::new(read));
        // The toolkit takes the text a frame after the focus has gone, by whatever key it went.
        let is_given_up = response.lost_focus() && ui.input(|input| input.key_pressed(Key::Escape));
        if is_given_up || ui.memory(|memory| memory.has_focus(response.id)) {
            ui.data_mut(|data| data.insert_temp(id, Typed { is_typed, is_given_up }));
        }
        response
    }
}

/// A number that is rounded to nothing has no sign.
fn without_minus(digits: String) -> String {
    let is_nothing = !digits.contains(|c: char| c.is_ascii_digit() && c != '0');
    match digits.strip_prefix(['-', '−']).filter(|_| is_nothing) {
        Some(rest) => rest.to_owned(),
        None => digits,
    }
}

/// What is known of the text in a field.
#[derive(Clone, Copy, Default)]
struct Typed {
    /// Whether a hand put anything in.
    is_typed: bool,
    is_given_up: bool,
}

/// Whether letters come in with this frame.
pub fn letters_come(ctx: &Context) -> bool {
    let is_letter = |event: &Event| matches!(event, Event::Text(_) | Event::Paste(_) | Event::Ime(ImeEvent::Commit(_)));
    ctx.input(|input| input.events.iter().any(is_letter))
}

/// Says that Escape was pressed, where what is drawn later in this frame no longer hears it.
pub fn give_up(ctx: &Context) {
    let pass = ctx.cumulative_pass_nr();
    ctx.data_mut(|data| data.insert_temp(Id::unique("given up"), pass));
}

fn is_given_up(ctx: &Context) -> bool {
    let pass = ctx.data(|data| data.get_temp(Id::unique("given up")));
    pass == Some(ctx.cumulative_pass_nr())
}

/// Keeps why a field stays as it was until the window says it.
fn refuse(ctx: &Context, text: &str) {
    let text: String = text.trim().chars().take(MOST_TOLD).collect();
    let words = format!("“{text}” cannot be read as a number here; what was there stays");
    ctx.data_mut(|data| data.insert_temp(Id::unique("refused"), words));
}

/// Why a field into which somebody typed stays as it was, told once.
pub fn take_refusal(ctx: &Context) -> Option<String> {
    ctx.data_mut(|data| data.remove_temp(Id::unique("refused")))
}

/// A finite number, with its unit behind it, the first word of that, or without. One comma stands for the point, but where it may set
/// thousands apart: which is meant is anybody's guess then.
pub fn number_of(text: &str, unit: &str) -> Option<f64> {
    let bare = |text: &str| -> String {
        text.chars().filter(|c| !c.is_whitespace()).map(|c| if c == '−' { '-' } else { c }).collect()
    };
    let text = bare(text);
    let first = unit.split_whitespace().next().unwrap_or_default();
    let digits = text.strip_suffix(bare(unit).as_str()).or_else(|| text.strip_suffix(first)).unwrap_or(&text);
    let decimal = match digits.split_once(',') {
        Some((whole, rest)) if rest.len() != 3 || whole.trim_start_matches(['+', '-']) == "0" => {
            format!("{whole}.{rest}")
        }
        _ => digits.to_owned(),
    };
    decimal.parse().ok().filter(|number: &f64| number.is_finite())
}

/// The number next to one, no less than `least`: for a field that shows a word in place of several numbers, or of none. Any number that is
/// typed there is another one, what the field would count from as well.
pub fn beside(number: f64, least: f64) -> f64 {
    if number > least { number.next_down() } else { number.next_up() }
}

/// What something was when the drag of a field began; `now`, before the field changed it, where none is under way. What goes along with a field follows from that, so
/// that a drag there and back leaves no trace.
pub fn before_drag<T: Clone + Send + Sync + 'static>(ui: &Ui, field: &Response, now: T) -> T {
    if !field.dragged() {
        return now;
    }
    let id = field.id.with("before the drag");
    ui.data_mut(|data| {
        if field.drag_started() {
            data.insert_temp(id, now.clone());
        }
        data.get_temp(id).unwrap_or(now)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn beside_a_number_lies_another_one_within_its_range() {
        for (number, least) in [(3000.0, 500.0), (500.0, 500.0), (0.0, 0.0), (-20.0, -20.0), (1e6, 0.0)] {
            let other = beside(number, least);
            assert!(other != number && other >= least && (other - number).abs() <= 1e-9, "{number}: {other}");
        }
    }

    #[test]
    fn in_a_model_a_drag_goes_less_far_and_more_digits_tell_it() {
        for extent_m in [Some(5.0), Some(3000.0), Some(f32::INFINITY), None] {
            assert_eq!(step_m(0.02, 2, extent_m), (0.02, 2));
            assert_eq!(step_m(0.01, 3, extent_m).1, 3);
        }
        let (step, digits) = step_m(0.02, 2, Some(0.05));
        assert!((step - 2e-4).abs() < 1e-9 && digits == 4, "{step} m, {digits} digits");
        assert!(step_m(0.02, 2, Some(0.0)).0 > 0.0);
    }

    #[test]
    fn what_is_rounded_to_nothing_has_no_sign() {
        let told = ["-0.000", "−0", "0.00", "-0.001", "-10", "5"].map(|digits| without_minus(digits.into()));
        assert_eq!(told, ["0.000", "0", "0.00", "-0.001", "-10", "5"]);
    }

    #[test]
    fn a_number_may_carry_its_own_unit_and_no_other() {
        let meters = |text: &str| number_of(text, " m");
        assert_eq!(["1.5", " 1.5 m", "−2m", "1 000"].map(meters), [1.5, 1.5, -2.0, 1000.0].map(Some));
        assert_eq!(["1,5", "-0,125 m", "2,25"].map(meters), [1.5, -0.125, 2.25].map(Some));
        assert_eq!(["1.5 cm", "m", "", "nan", "inf", "1,920", "1,5,2"].map(meters), [None; 7]);
        assert_eq!(["48.1°", "48,1° N", "48.1"].map(|text| number_of(text, "° N")), [Some(48.1); 3]);
    }
}
