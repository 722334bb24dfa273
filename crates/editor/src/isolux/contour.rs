//! Lines of equal value in a grid of values: marching squares, the segments joined into lines \[Lorensen1987\].

use std::collections::HashMap;

/// Values at the middles of pixels, row by row.
pub(super) struct Field {
    pub width: usize,
    pub height: usize,
    pub values: Vec<f32>,
    /// Factor between neighbors beyond which there is no line between them.
    pub jump: f32,
}

/// A border between two neighboring pixels' middles that a line crosses: twice the index of the upper left one, and one more if the
/// other lies below it instead of beside it.
type Edge = usize;

/// All lines of a value, open ones first; positions in pixels.
pub(super) fn contours(field: &Field, level: f32) -> Vec<Vec<[f32; 2]>> {
    let mut neighbors: HashMap<Edge, [Option<Edge>; 2]> = HashMap::new();
    // In the order of rows, so that the same picture gives the same lines.
    let mut order = Vec::new();
    for [a, b] in segments(field, level) {
        for (from, to) in [(a, b), (b, a)] {
            let ends = neighbors.entry(from).or_insert_with(|| {
                order.push(from);
                [None, None]
            });
            ends[usize::from(ends[0].is_some())] = Some(to);
        }
    }
    let is_end = |edge: &Edge| neighbors[edge][1].is_none();
    let starts: Vec<Edge> = order.iter().filter(|edge| is_end(edge)).chain(&order).copied().collect();
    let mut lines = Vec::new();
    for start in starts {
        let edges = follow(&mut neighbors, start);
        if edges.len() > 1 {
            lines.push(edges.into_iter().map(|edge| crossing(field, level, edge)).collect());
        }
    }
    lines
}

/// Walks from an edge to the end of its line, or around it, and takes the way out of `neighbors`.
fn follow(neighbors: &mut HashMap<Edge, [Option<Edge>; 2]>, start: Edge) -> Vec<Edge> {
    let mut line = vec![start];
    let mut here = start;
    while let Some(next) = take(neighbors, here, None) {
        take(neighbors, next, Some(here));
        line.push(next);
        here = next;
    }
    line
}

/// Takes a neighbor of an edge, or the one that is asked for.
fn take(neighbors: &mut HashMap<Edge, [Option<Edge>; 2]>, edge: Edge, wanted: Option<Edge>) -> Option<Edge> {
    let ends = neighbors.get_mut(&edge)?;
    let is_wanted = |end: &Option<Edge>| end.is_some() && (wanted.is_none() || *end == wanted);
    ends.iter_mut().find(|end| is_wanted(end))?.take()
}

/// Pairs of edges that a line joins, one or two for each square of four pixels that it passes.
fn segments(field: &Field, level: f32) -> impl Iterator<Item = [Edge; 2]> + '_ {
    let columns = field.width.saturating_sub(1);
    (0..field.height.saturating_sub(1)).flat_map(move |y| {
        (0..columns).flat_map(move |x| square(field, level, y * field.width + x).into_iter().flatten())
    })
}

fn square(field: &Field, level: f32, at: usize) -> [Option<[Edge; 2]>; 2] {
    let corners = [at, at + 1, at + field.width + 1, at + field.width].map(|index| field.values[index]);
    let bits = corners.map(|value| value >= level);
    let (least, most) = corners.iter().fold((f32::INFINITY, 0.0f32), |(l, m), value| (l.min(*value), m.max(*value)));
    if bits == [bits[0]; 4] || !corners.iter().all(|value| value.is_finite()) || most > field.jump * least.max(0.0) {
        return [None, None];
    }
    // Around the square from its upper side on; side n lies between corners n and n + 1.
    let sides = [2 * at, 2 * (at + 1) + 1, 2 * (at + field.width), 2 * at + 1];
    let crossed: Vec<Edge> = (0..4).filter(|&n| bits[n] != bits[(n + 1) % 4]).map(|n| sides[n]).collect();
    match crossed[..] {
        [a, b] => [Some([a, b]), None],
        // A saddle: the middle says which corners belong together.
        [top, right, bottom, left] => {
            let is_high = corners.iter().sum::<f32>() / 4.0 >= level;
            if is_high == bits[0] {
                [Some([top, right]), Some([bottom, left])]
            } else {
                [Some([left, top]), Some([right, bottom])]
            }
        }
        _ => [None, None],
    }
}

/// Where the value is met between the two pixels of an edge.
fn crossing(field: &Field, level: f32, edge: Edge) -> [f32; 2] {
    let (from, is_down) = (edge / 2, edge % 2 == 1);
    let to = from + if is_down { field.width } else { 1 };
    let (a, b) = (field.values[from], field.values[to]);
    let share = ((level - a) / (b - a)).clamp(0.0, 1.0);
    let [x, y] = [(from % field.width) as f32 + 0.5, (from / field.width) as f32 + 0.5];
    if is_down { [x, y + share] } else { [x + share, y] }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lines(width: usize, values: &[f32]) -> Vec<Vec<[f32; 2]>> {
        contours(&Field { width, height: values.len() / width, values: values.to_vec(), jump: f32::INFINITY }, 1.0)
    }

    #[test]
    fn a_slope_is_crossed_once_where_the_value_lies() {
        assert_eq!(
            lines(3, &[0.0, 0.5, 2.5, 0.0, 0.5, 2.5, 0.0, 0.5, 2.5]),
            [vec![[1.75, 0.5], [1.75, 1.5], [1.75, 2.5]]]
        );
    }

    #[test]
    fn a_peak_is_circled_and_the_circle_closes() {
        let found = lines(3, &[0.0, 0.0, 0.0, 0.0, 2.0, 0.0, 0.0, 0.0, 0.0]);
        assert_eq!(found.len(), 1);
        assert!(found[0].len() == 5 && found[0][0] == found[0][4], "{found:?}");
        assert!(found[0].iter().all(|[x, y]| (x - 1.5).abs() + (y - 1.5).abs() == 0.5), "{found:?}");
    }

    #[test]
    fn a_saddle_has_two_lines_that_do_not_cross() {
        let low = lines(2, &[2.0, 0.0, 0.0, 1.5]);
        assert_eq!(low.len(), 2, "{low:?}");
        // The middle is dark: each bright corner is cut off for itself.
        assert!(
            low.iter()
                .all(|line| line.len() == 2 && (line[0][0] + line[0][1] < 2.0) == (line[1][0] + line[1][1] < 2.0))
        );
        let high = lines(2, &[4.0, 0.0, 0.0, 4.0]);
        assert!(high.len() == 2 && high != low);
    }

    #[test]
    fn a_line_ends_where_the_light_jumps() {
        let values = [0.9, 0.9, 0.9, 0.5, 1.1, 1.1, 1.1, 9.0];
        let field = |jump: f32| Field { width: 4, height: 2, values: values.to_vec(), jump };
        let n_points = |jump: f32| contours(&field(jump), 1.0).iter().map(Vec::len).sum::<usize>();
        assert_eq!((n_points(f32::INFINITY), n_points(1.6)), (4, 3));
    }

    #[test]
    fn what_is_no_number_and_what_is_too_small_has_no_line() {
        assert!(lines(2, &[f32::NAN, 0.0, 2.0, 2.0]).is_empty());
        assert!(lines(1, &[0.0, 2.0]).is_empty() && lines(2, &[0.0, 2.0]).is_empty());
    }
}
