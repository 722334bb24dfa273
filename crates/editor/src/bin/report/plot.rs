//! Plots as SVG: panels of curves beside each other, one legend below. Nothing but what the report draws.

use std::fmt::Write;

/// How an axis grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Scale {
    /// Alike steps for alike differences.
    Linear,
    /// Alike steps for alike ratios; only what is above zero is drawn.
    Log,
    /// One place after the other, without numbers; up, each series has its name beside it.
    Order,
}

/// One side of a panel.
pub struct Axis {
    /// What it counts, with its unit.
    pub label: &'static str,
    /// How it grows.
    pub scale: Scale,
}

/// Points of one thing, by its name.
pub struct Series {
    /// Name in the legend; the same name has the same color in all panels.
    pub name: String,
    /// Points (x, y) in the order in which they are joined.
    pub points: Vec<[f64; 2]>,
    /// Whether a line joins them.
    pub is_joined: bool,
}

/// Curves over common axes.
pub struct Panel {
    /// What it shows.
    pub title: String,
    /// Across.
    pub x: Axis,
    /// Up.
    pub y: Axis,
    /// What is drawn, the first uppermost.
    pub series: Vec<Series>,
}

/// Side of a panel in pixels, its labels included.
const SIZE: [f64; 2] = [372.0, 270.0];
/// Room for labels: left, top, right, bottom.
const MARGIN: [f64; 4] = [54.0, 26.0, 14.0, 42.0];
/// Length of a mark on an axis that is not told.
const SHORT: f64 = 5.0;
const MOST_ACROSS: usize = 3;
/// Radius of a mark, and where series may cover each other of the uppermost: each that lies below is larger by a step, so that of points
/// in one place all are seen.
const RADIUS: f64 = 3.0;
const UPPERMOST_RADIUS: f64 = 2.2;
const RADIUS_STEP: f64 = 0.5;
const LARGEST_RADIUS: f64 = 5.2;
const LEGEND_ROW: f64 = 18.0;
const LEGEND_ENTRY: f64 = 186.0;
const LEGEND_LETTERS: usize = 30;
/// Colors that people tell apart whichever way they see them \[Okabe2008\].
const COLORS: [&str; 8] = ["#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#8c7a00"];
const FONT: &str = "font-family=\"Helvetica, Arial, sans-serif\"";

/// A picture of all panels.
pub fn figure(panels: &[Panel]) -> String {
    let mut names: Vec<&str> = Vec::new();
    for series in panels.iter().flat_map(|panel| &panel.series) {
        if !names.contains(&series.name.as_str()) {
            names.push(&series.name);
        }
    }
    let across = panels.len().clamp(1, MOST_ACROSS);
    let down = panels.len().div_ceil(across);
    let width = across as f64 * SIZE[0];
    let per_row = ((width / LEGEND_ENTRY) as usize).max(1);
    let legend_top = down as f64 * SIZE[1];
    let height = legend_top + names.len().div_ceil(per_row) as f64 * LEGEND_ROW + 10.0;
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {width} {height}\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#ffffff\"/>\n"
    );
    for (nth, panel) in panels.iter().enumerate() {
        let at = [(nth % across) as f64 * SIZE[0], (nth / across) as f64 * SIZE[1]];
        svg += &drawn(panel, at, &names);
    }
    for (nth, name) in names.iter().enumerate() {
        let [x, y] =
            [12.0 + (nth % per_row) as f64 * LEGEND_ENTRY, legend_top + ((nth / per_row) as f64 + 0.5) * LEGEND_ROW];
        svg += &mark(nth, [x + 4.0, y], RADIUS);
        svg += &text([x + 14.0, y + 4.0], "start", 11.0, &shortened(name));
    }
    svg + "</svg>\n"
}

/// Where values lie on a side of a panel.
struct Place {
    scale: Scale,
    /// Values at the ends, as logarithms where the scale is.
    ends: [f64; 2],
    /// Pixels at the ends.
    pixels: [f64; 2],
}

impl Place {
    fn new(scale: Scale, values: impl Iterator<Item = f64>, pixels: [f64; 2]) -> Place {
        let values = values.filter_map(|value| on(scale, value));
        let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[low, high], x| [low.min(x), high.max(x)]);
        let [low, high] = if low <= high { [low, high] } else { [0.0, 1.0] };
        let margin = if high > low { 0.05 * (high - low) } else { 0.5 };
        Place { scale, ends: [low - margin, high + margin], pixels }
    }

    fn of(&self, value: f64) -> Option<f64> {
        let share = (on(self.scale, value)? - self.ends[0]) / (self.ends[1] - self.ends[0]);
        Some(self.pixels[0] + share * (self.pixels[1] - self.pixels[0]))
    }

    /// Values that are told, a handful.
    fn ticks(&self) -> Vec<f64> {
        let [low, high] = self.ends;
        match self.scale {
            Scale::Order => Vec::new(),
            Scale::Linear => {
                let rough = (high - low) / 8.0;
                let unit = 10f64.powf(rough.log10().floor());
                let step = [1.0, 2.0, 5.0, 10.0].map(|factor| factor * unit).into_iter().find(|step| *step >= rough);
                let step = step.unwrap_or(rough);
                let first = (low / step).ceil() as i64;
                (first..).map(|nth| nth as f64 * step).take_while(|value| *value <= high).collect()
            }
            Scale::Log => {
                let factors: &[f64] = if high - low > 2.5 { &[1.0] } else { &[1.0, 2.0, 5.0] };
                let decades = low.floor() as i32..=high.ceil() as i32;
                let all = decades.flat_map(|decade| factors.iter().map(move |factor| factor * 10f64.powi(decade)));
                all.filter(|value| (low..=high).contains(&value.log10())).collect()
            }
        }
    }

    /// Values between them that are shown and not told.
    fn between_ticks(&self) -> Vec<f64> {
        if self.scale != Scale::Log {
            return Vec::new();
        }
        let [low, high] = self.ends;
        let decades = low.floor() as i32..=high.ceil() as i32;
        let all = decades.flat_map(|decade| (2..10).map(move |factor| f64::from(factor) * 10f64.powi(decade)));
        all.filter(|value| (low..=high).contains(&value.log10())).collect()
    }
}

fn on(scale: Scale, value: f64) -> Option<f64> {
    let value = if scale == Scale::Log { value.log10() } else { value };
    value.is_finite().then_some(value)
}

fn drawn(panel: &Panel, [left, top]: [f64; 2], names: &[&str]) -> String {
    let [right, bottom] = [left + SIZE[0] - MARGIN[2], top + SIZE[1] - MARGIN[3]];
    let (left, inner_top) = (left + MARGIN[0], top + MARGIN[1]);
    let values = |axis: usize| panel.series.iter().flat_map(move |series| series.points.iter().map(move |p| p[axis]));
    let x = Place::new(panel.x.scale, values(0), [left, right]);
    let y = Place::new(panel.y.scale, values(1), [bottom, inner_top]);
    let mut svg = text([left, top + 17.0], "start", 13.0, &panel.title);
    for at in x.between_ticks().into_iter().filter_map(|value| x.of(value)) {
        svg += &line([at, bottom - SHORT], [at, bottom]);
    }
    for at in y.between_ticks().into_iter().filter_map(|value| y.of(value)) {
        svg += &line([left, at], [left + SHORT, at]);
    }
    for (value, at) in x.ticks().into_iter().filter_map(|value| Some((value, x.of(value)?))) {
        svg += &line([at, inner_top], [at, bottom]);
        svg += &text([at, bottom + 14.0], "middle", 10.0, &told(value));
    }
    for (value, at) in y.ticks().into_iter().filter_map(|value| Some((value, y.of(value)?))) {
        svg += &line([left, at], [right, at]);
        svg += &text([left - 5.0, at + 3.5], "end", 10.0, &told(value));
    }
    svg += &text([0.5 * (left + right), bottom + 31.0], "middle", 11.0, panel.x.label);
    let (at_x, at_y) = (left - 40.0, 0.5 * (inner_top + bottom));
    let _ = writeln!(
        svg,
        "<text x=\"{at_x:.1}\" y=\"{at_y:.1}\" transform=\"rotate(-90 {at_x:.1} {at_y:.1})\" text-anchor=\"middle\" font-size=\"11\" {FONT}>{}</text>",
        escaped(panel.y.label)
    );
    for (depth, series) in panel.series.iter().enumerate().rev() {
        let nth = names.iter().position(|name| *name == series.name).unwrap_or(0);
        let points: Vec<[f64; 2]> = series.points.iter().filter_map(|p| Some([x.of(p[0])?, y.of(p[1])?])).collect();
        if series.is_joined && points.len() > 1 {
            let path: Vec<String> = points.iter().map(|[x, y]| format!("{x:.1},{y:.1}")).collect();
            let color = COLORS[nth % COLORS.len()];
            let _ = writeln!(
                svg,
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"1.6\"/>",
                path.join(" ")
            );
        }
        let radius = radius(depth, panel.y.scale, series.is_joined);
        points.iter().for_each(|point| svg += &mark(nth, *point, radius));
        if panel.y.scale == Scale::Order
            && let Some([_, y]) = points.first()
        {
            svg += &text([left + 4.0, y - 4.0], "start", 9.0, &series.name);
        }
    }
    svg
}

/// Of the marks of a series below so many others; alike where each has a place of its own, and least where no line joins them, as they are
/// many then.
fn radius(depth: usize, scale: Scale, is_joined: bool) -> f64 {
    match (scale, is_joined) {
        (Scale::Order, _) => RADIUS,
        (_, false) => UPPERMOST_RADIUS,
        (_, true) => (UPPERMOST_RADIUS + RADIUS_STEP * depth as f64).min(LARGEST_RADIUS),
    }
}

/// A disk, a square or a diamond of about a radius: names beyond the colors differ by shape.
fn mark(nth: usize, [x, y]: [f64; 2], radius: f64) -> String {
    let color = COLORS[nth % COLORS.len()];
    match nth / COLORS.len() {
        0 => format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"{radius:.1}\" fill=\"{color}\"/>\n"),
        1 => {
            let half = 0.93 * radius;
            format!(
                "<rect x=\"{:.1}\" y=\"{:.1}\" width=\"{:.1}\" height=\"{:.1}\" fill=\"{color}\"/>\n",
                x - half,
                y - half,
                2.0 * half,
                2.0 * half
            )
        }
        _ => {
            let half = 1.27 * radius;
            format!(
                "<path d=\"M {x:.1} {:.1} l {half:.1} {half:.1} l -{half:.1} {half:.1} l -{half:.1} -{half:.1} z\" fill=\"{color}\"/>\n",
                y - half
            )
        }
    }
}

fn line([x1, y1]: [f64; 2], [x2, y2]: [f64; 2]) -> String {
    format!("<path d=\"M {x1:.1} {y1:.1} L {x2:.1} {y2:.1}\" stroke=\"#dddddd\"/>\n")
}

fn text([x, y]: [f64; 2], anchor: &str, size: f64, words: &str) -> String {
    format!(
        "<text x=\"{x:.1}\" y=\"{y:.1}\" text-anchor=\"{anchor}\" font-size=\"{size}\" fill=\"#222222\" {FONT}>{}</text>\n",
        escaped(words)
    )
}

fn escaped(words: &str) -> String {
    words.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;")
}

/// What fits into an entry of the legend.
fn shortened(name: &str) -> String {
    if name.chars().count() <= LEGEND_LETTERS {
        return name.into();
    }
    name.chars().take(LEGEND_LETTERS - 1).chain(['…']).collect()
}

/// A number of an axis, with no more digits than it needs.
fn told(value: f64) -> String {
    match value.abs() {
        size if size >= 1e6 => format!("{}M", value / 1e6),
        size if size >= 1e4 => format!("{}k", value / 1e3),
        _ => format!("{}", (value * 1e9).round() / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tenfold_is_the_same_way_anywhere_on_a_log_axis() {
        let place = Place::new(Scale::Log, [1.0, 10.0, 1000.0, 0.0].into_iter(), [0.0, 330.0]);
        let at = [1.0, 10.0, 100.0, 1000.0].map(|value| place.of(value).expect("above zero"));
        assert!((at[1] - at[0] - 100.0).abs() < 1e-9 && (at[3] - at[2] - 100.0).abs() < 1e-9, "{at:?}");
        assert_eq!((place.of(0.0), place.ticks()), (None, vec![1.0, 10.0, 100.0, 1000.0]));
        let between = place.between_ticks();
        assert!(between.contains(&20.0) && between.contains(&900.0) && !between.contains(&10.0), "{between:?}");
        assert_eq!(
            Place::new(Scale::Linear, [20.0, 40.0].into_iter(), [0.0, 1.0]).ticks(),
            [20.0, 25.0, 30.0, 35.0, 40.0]
        );
    }

    #[test]
    fn the_first_of_points_in_one_place_lies_above_and_the_others_show_around_it() {
        let axis = |scale: Scale| Axis { label: "dB", scale };
        let series = |name: &str, is_joined: bool| Series { name: name.into(), points: vec![[1.0, 2.0]], is_joined };
        let radii = |scale: Scale| {
            let series = vec![series("ours", true), series("theirs", true), series("others", false)];
            let panel = Panel { title: String::new(), x: axis(Scale::Linear), y: axis(scale), series };
            let svg = figure(&[panel]);
            let circles = svg.lines().filter(|line| line.starts_with("<circle"));
            // Behind those of the panel come those of the legend.
            let radius = |line: &str| line.split_once(" r=\"")?.1.split_once('"').map(|(radius, _)| radius.to_string());
            circles.take(3).map(|line| radius(line).expect("a circle has a radius")).collect::<Vec<String>>()
        };
        assert_eq!(radii(Scale::Linear), ["2.2", "2.7", "2.2"], "others first, ours last");
        assert_eq!(radii(Scale::Order), ["3.0"; 3], "each has a place of its own");
    }

    #[test]
    fn a_name_has_one_color_and_one_line_in_the_legend() {
        let axis = || Axis { label: "s & dB", scale: Scale::Linear };
        let series = |name: &str| Series { name: name.into(), points: vec![[0.0, 1.0], [1.0, 2.0]], is_joined: true };
        let panel = |names: &[&str]| Panel {
            title: "a < b".into(),
            x: axis(),
            y: axis(),
            series: names.iter().map(|name| series(name)).collect(),
        };
        let svg = figure(&[panel(&["ours", "theirs"]), panel(&["theirs"])]);
        assert_eq!(svg.matches(">theirs</text>").count(), 1);
        assert_eq!(svg.matches(&format!("stroke=\"{}\"", COLORS[1])).count(), 2, "the line of `theirs` in both panels");
        assert!(svg.contains("a &lt; b") && svg.contains("s &amp; dB"));
        let in_order = Panel { y: Axis { label: "", scale: Scale::Order }, ..panel(&["ours"]) };
        assert_eq!(figure(&[in_order]).matches(">ours</text>").count(), 2, "in the legend and beside the line");
    }
}
