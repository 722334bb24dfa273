//! From wishes to equations, and from their answer to a lighting.

use anyhow::{Context, Result};
use clerestory_nystrom::BoundedLeastSquares;
use clerestory_transport::camera::Film;
use clerestory_transport::light::LightSetting;

use super::lights::{Unknown, with};
use super::report::{Change, Outcome, Solution, size_of};
use super::rows::{Row, Rows, luminance};
use super::{Exposure, Freedom, Place, Request, Scene, Target, Wish};
use crate::look::Units;

mod matching;

use matching::Matching;

/// Cells of the picture, about.
const CELLS: u32 = 2304;
/// An intensity below this counts as this in what a change costs.
const LEAST_INTENSITY: f64 = 0.1;
/// A change of color costs so many times what a change of intensity does.
const COLOR_PULL: f64 = 10.0;
/// Share of the mean of the picture that counts as no light, so that the dark does not rule.
const DARK: f64 = 0.05;
/// Rounds in which lights that are beyond their limits are brought back, and in which the scale of the pull is found.
const MOST_ROUNDS: usize = 8;
/// Lights that end at so many times what they were, on average, are pulled by what they were.
const NEAR: f64 = 2.0;
/// Growth of the scale of the pull that ends its rounds.
const SAME_SCALE: f64 = 1.01;

/// A wish about a mean.
struct Mean<'a> {
    wish: &'a Wish,
    row: Row,
    wanted: f64,
    before: f64,
}

/// The unknowns of all lights in a row, and what holds for them.
pub(super) struct Layout {
    /// First unknown of each light, and their number at the end.
    first: Vec<usize>,
    start: Vec<f64>,
    /// Of each unknown alone: a channel that is sought may go out.
    bounds: Vec<[f64; 2]>,
    /// Least and largest luminance of each light whose channels are sought, over that of a white lamp at intensity 1.
    limits: Vec<[f64; 2]>,
}

/// A square of the picture, and its mean.
pub(super) struct Cell {
    /// `[left, top, right, bottom]` in pixels.
    pub rect: [f32; 4],
    pub row: Row,
}

impl Layout {
    fn new(unknowns: &[Unknown], [least, most]: [f64; 2]) -> Layout {
        let (mut first, mut start, mut bounds) = (vec![0], Vec::new(), Vec::new());
        let limits = unknowns.iter().map(|unknown| [least, most].map(|times| times * unknown.luminance())).collect();
        for unknown in unknowns {
            start.extend(unknown.present());
            if unknown.is_colored {
                let brightest = f64::from(unknown.color.max_element());
                bounds.extend([[0.0, most * brightest]; 3]);
            } else {
                bounds.push([least, most]);
            }
            first.push(start.len());
        }
        Layout { first, start, bounds, limits }
    }

    fn n(&self) -> usize {
        self.start.len()
    }

    fn of<'x>(&self, light: usize, x: &'x [f64]) -> &'x [f64] {
        &x[self.first[light]..self.first[light + 1]]
    }

    /// A channel of a row, as an equation's left side.
    fn channel(&self, row: &Row, c: usize) -> Vec<(usize, f64)> {
        let of = |(light, share): (usize, &[f64; 3])| {
            let is_colored = self.first[light + 1] - self.first[light] == 3;
            (self.first[light] + if is_colored { c } else { 0 }, share[c])
        };
        row.shares.iter().enumerate().map(of).collect()
    }

    /// The luminance of a row.
    fn luminance(&self, row: &Row) -> Vec<(usize, f64)> {
        let mut terms = Vec::new();
        for (light, share) in row.shares.iter().enumerate() {
            let first = self.first[light];
            if self.first[light + 1] - first == 3 {
                let alone = |c: usize| luminance(std::array::from_fn(|k| if k == c { share[c] } else { 0.0 }));
                terms.extend((0..3).map(|c| (first + c, alone(c))));
            } else {
                terms.push((first, luminance(*share)));
            }
        }
        terms
    }

    /// Least and most luminance of a row.
    fn range(&self, row: &Row) -> [f64; 2] {
        let mut range = [luminance(row.fixed); 2];
        for (light, share) in row.shares.iter().enumerate() {
            let first = self.first[light];
            if self.first[light + 1] - first == 3 {
                let of_light = spread(share, self.limits[light], self.bounds[first][1]);
                (0..2).for_each(|end| range[end] += of_light[end]);
            } else {
                (0..2).for_each(|end| range[end] += luminance(*share) * self.bounds[first][end]);
            }
        }
        range
    }

    /// A row under some lights, RGB.
    fn value(&self, row: &Row, x: &[f64]) -> [f64; 3] {
        std::array::from_fn(|c| row.fixed[c] + self.channel(row, c).iter().map(|&(i, a)| a * x[i]).sum::<f64>())
    }
}

/// Least and most luminance that a light brings whose own lies between two limits, in whatever color; no channel is beyond
/// `brightest`.
fn spread(share: &[f64; 3], [least, most]: [f64; 2], brightest: f64) -> [f64; 2] {
    let mut channels: [usize; 3] = [0, 1, 2];
    channels.sort_by(|a, b| share[*a].total_cmp(&share[*b]));
    let brought = |mut left: f64, channels: &mut dyn Iterator<Item = usize>| {
        let mut sum = 0.0;
        for c in channels {
            let all = luminance(std::array::from_fn(|k| if k == c { brightest } else { 0.0 }));
            sum += share[c] * left.min(all);
            left -= left.min(all);
        }
        sum
    };
    [brought(least, &mut channels.into_iter()), brought(most, &mut channels.into_iter().rev())]
}

pub(super) fn fit(scene: &Scene, request: &Request, unknowns: &[Unknown], rows: &Rows) -> Result<Solution> {
    let layout = Layout::new(unknowns, request.bounds);
    let means = request.wishes.iter().filter_map(|wish| mean(scene, wish, rows, &layout).transpose());
    let means: Vec<Mean> = means.collect::<Result<_>>()?;
    let cells = cells(scene, rows)?;
    let mut base = BoundedLeastSquares::new(layout.n());
    means.iter().for_each(|mean| add_mean(&mut base, mean, &layout));
    keep_rest(&mut base, scene, request, &cells, &layout);

    let film = Film { width: scene.bake.header.width, height: scene.bake.header.height };
    let matchings: Vec<Matching> =
        request.wishes.iter().filter_map(|wish| Matching::new(wish, film, &cells, &layout)).collect();
    let (x, matchings) = pulled(request, unknowns, (&base, &matchings), (&means, &cells), &layout)?;

    let settings: Vec<LightSetting> =
        unknowns.iter().enumerate().map(|(light, unknown)| unknown.set_to(layout.of(light, &x))).collect();
    // Light that is kept is no wish to be missed.
    let (mut told, mut matched) = (means.iter(), matchings.iter());
    let units = Units::of(&scene.bake.header.basis);
    let outcome_of = |wish: &Wish| match wish.target {
        Target::Keep => None,
        Target::Picture(..) => matched.next().map(|matching| matching.outcome(wish, &cells, &layout, &x)),
        _ => told.next().map(|mean| outcome(mean, &x, &layout, request.bounds, units)),
    };
    let outcomes: Vec<Outcome> = request.wishes.iter().filter_map(outcome_of).collect();
    let missable = request.wishes.iter().filter(|wish| !matches!(wish.target, Target::Keep));
    let weights: Vec<f64> = missable.map(|wish| wish.weight).collect();
    let changes = unknowns.iter().zip(&settings).enumerate().map(|(light, (unknown, setting))| {
        let intensity = unknown.intensity(layout.of(light, &x));
        let is_at = |bound: f64| (intensity - bound).abs() <= 1e-9 * bound.abs().max(1.0);
        let at_bound = request.bounds.iter().position(|bound| is_at(*bound));
        Change { key: unknown.key.clone(), before: unknown.own, after: *setting, at_bound }
    });
    Ok(Solution {
        changes: changes.collect(),
        misfit: misfit(&outcomes, &weights),
        rig: with(&scene.rig, unknowns, &settings),
        outcomes,
        notes: notes(scene, request, film),
    })
}

/// A wish that is about a mean; `None` for those cell by cell.
fn mean<'a>(scene: &Scene, wish: &'a Wish, rows: &Rows, layout: &Layout) -> Result<Option<Mean<'a>>> {
    let everywhere: Vec<u32>;
    let pixels = match &wish.place {
        Place::Marks(marks) => marks.pixels(),
        Place::Whole | Place::Grid(_) => {
            everywhere = (0..scene.bake.header.width * scene.bake.header.height).collect();
            &everywhere
        }
    };
    anyhow::ensure!(!pixels.is_empty(), "the wish `{}` is about no pixel; mark a part of the picture", wish.name);
    let row = match (&wish.target, &wish.place) {
        (Target::Keep | Target::Picture(..), _) => return Ok(None),
        (Target::Luminance(_), Place::Grid(_)) => {
            anyhow::bail!("the wish `{}` is for cd/m² at a sensor grid, which tells lux; wish for lux there", wish.name)
        }
        (_, Place::Grid(set)) => rows.grid(*set),
        (Target::Illuminance(_), _) => rows.irradiance(pixels),
        (Target::Luminance(_) | Target::Times(_), _) => rows.radiance(pixels),
    };
    let row = row.with_context(|| format!("cannot solve for the wish `{}`", wish.name))?;
    let before = luminance(layout.value(&row, &layout.start));
    let wanted = match wish.target {
        Target::Illuminance(wanted) | Target::Luminance(wanted) => wanted,
        Target::Times(times) => times * before,
        Target::Keep | Target::Picture(..) => before,
    };
    Ok(Some(Mean { wish, row, wanted, before }))
}

/// A wish counts by its miss over what is wanted.
fn add_mean(problem: &mut BoundedLeastSquares, mean: &Mean, layout: &Layout) {
    let size = size_of(mean.wanted, mean.before);
    let b = mean.wanted - luminance(mean.row.fixed);
    problem.add(&layout.luminance(&mean.row), b, mean.wish.weight / (size * size));
}

/// The picture in squares, each with its row.
fn cells(scene: &Scene, rows: &Rows) -> Result<Vec<Cell>> {
    let (width, height) = (scene.bake.header.width, scene.bake.header.height);
    let side = ((width * height) as f32 / CELLS as f32).sqrt().ceil().max(1.0) as u32;
    let mut rects = Vec::new();
    for top in (0..height).step_by(side as usize) {
        rects.extend(
            (0..width)
                .step_by(side as usize)
                .map(|left| [left, top, (left + side).min(width), (top + side).min(height)]),
        );
    }
    let pixels = |[left, top, right, bottom]: &[u32; 4]| -> Vec<u32> {
        (*top..*bottom).flat_map(|y| (*left..*right).map(move |x| y * width + x)).collect()
    };
    let rows = rows.radiances(&rects.iter().map(pixels).collect::<Vec<_>>())?;
    Ok(rects.into_iter().zip(rows).map(|(rect, row)| Cell { rect: rect.map(|edge| edge as f32), row }).collect())
}

/// What no wish names is to stay as it is, and so is what a wish to keep names.
fn keep_rest(problem: &mut BoundedLeastSquares, scene: &Scene, request: &Request, cells: &[Cell], layout: &Layout) {
    let width = scene.bake.header.width;
    let middle = |cell: &Cell| {
        let [left, top, right, bottom] = cell.rect;
        (0.5 * (top + bottom)) as u32 * width + (0.5 * (left + right)) as u32
    };
    let is_in = |wish: &Wish, cell: &Cell| match &wish.place {
        Place::Marks(marks) => marks.holds(middle(cell)),
        Place::Whole => true,
        Place::Grid(_) => false,
    };
    let rest: Vec<&Cell> = cells.iter().filter(|cell| !request.wishes.iter().any(|wish| is_in(wish, cell))).collect();
    add_kept(problem, &rest, request.keep, layout);
    for wish in request.wishes.iter().filter(|wish| matches!(wish.target, Target::Keep)) {
        let kept: Vec<&Cell> = cells.iter().filter(|cell| is_in(wish, cell)).collect();
        add_kept(problem, &kept, wish.weight, layout);
    }
}

fn add_kept(problem: &mut BoundedLeastSquares, cells: &[&Cell], weight: f64, layout: &Layout) {
    let now: Vec<[f64; 3]> = cells.iter().map(|cell| layout.value(&cell.row, &layout.start)).collect();
    let mean = now.iter().map(|rgb| luminance(*rgb)).sum::<f64>() / cells.len().max(1) as f64;
    for (cell, now) in cells.iter().zip(&now) {
        let size = luminance(*now) + DARK * mean;
        if size <= 0.0 {
            continue;
        }
        for (c, now) in now.iter().enumerate() {
            let weight = weight / (3.0 * cells.len() as f64 * size * size);
            problem.add(&layout.channel(&cell.row, c), now - cell.row.fixed[c], weight);
        }
    }
}

/// Solves with a pull to the present setting; answers with the pictures as they were weighed for it. The pull grows with the square of
/// a light, and would outweigh every wish where lights end at many times what they were: there it is measured by what was reached, and
/// solved again, until that grows no more.
fn pulled(
    request: &Request,
    unknowns: &[Unknown],
    (base, unweighed): (&BoundedLeastSquares, &[Matching]),
    (means, cells): (&[Mean], &[Cell]),
    layout: &Layout,
) -> Result<(Vec<f64>, Vec<Matching>)> {
    let (mut scale, mut n_rounds) = (1.0, 0);
    loop {
        let mut base = base.clone();
        pull(&mut base, unknowns, request.pull / scale, layout);
        let mut matchings = unweighed.to_vec();
        let x = within_limits(request.freedom, unknowns, layout, |bounds| {
            matching::solve(&base, &mut matchings, cells, layout, bounds)
        })?;
        let of_pictures: &[Cell] = if matchings.is_empty() { &[] } else { cells };
        let rows = means.iter().map(|mean| &mean.row).chain(of_pictures.iter().map(|cell| &cell.row));
        let reached = mean_factor(rows, unknowns, layout, &x) / NEAR;
        n_rounds += 1;
        if reached <= SAME_SCALE * scale || n_rounds == MOST_ROUNDS {
            return Ok((x, matchings));
        }
        scale = reached;
    }
}

/// How many times what they were the lights are, each by its share of what the rows show.
fn mean_factor<'r>(rows: impl Iterator<Item = &'r Row>, unknowns: &[Unknown], layout: &Layout, x: &[f64]) -> f64 {
    let factor = |(light, unknown): (usize, &Unknown)| {
        unknown.intensity(layout.of(light, x)) / f64::from(unknown.own.intensity).max(LEAST_INTENSITY)
    };
    let factors: Vec<f64> = unknowns.iter().enumerate().map(factor).collect();
    let (mut sum, mut n_lit) = (0.0, 0u32);
    for row in rows {
        let brought = |(light, share): (usize, &[f64; 3])| {
            let found = layout.of(light, x);
            luminance(std::array::from_fn(|c| share[c] * found[c.min(found.len() - 1)])).abs()
        };
        let brought: Vec<f64> = row.shares.iter().enumerate().map(brought).collect();
        let all: f64 = brought.iter().sum();
        if all > 0.0 {
            sum += brought.iter().zip(&factors).map(|(brought, factor)| brought / all * factor).sum::<f64>();
            n_lit += 1;
        }
    }
    sum / f64::from(n_lit.max(1))
}

/// The pull to the present setting: a light that doubles costs `strength`², one that changes its color more.
fn pull(problem: &mut BoundedLeastSquares, unknowns: &[Unknown], strength: f64, layout: &Layout) {
    let square = strength * strength;
    for light in 0..unknowns.len() {
        let (first, start) = (layout.first[light], layout.of(light, &layout.start));
        let least = LEAST_INTENSITY.max(LEAST_INTENSITY * start.iter().fold(0.0, |most: f64, x| most.max(*x)));
        let per: Vec<f64> = start.iter().map(|x| 1.0 / x.max(least)).collect();
        let &[r, g, b] = &per[..] else {
            problem.add(&[(first, per[0])], start[0] * per[0], square);
            continue;
        };
        let relative = [r, g, b];
        let weights: [f64; 3] =
            std::array::from_fn(|c| luminance(std::array::from_fn(|k| f64::from(u8::from(k == c)))));
        let mean = |c: usize| weights[c] * relative[c];
        let at = |row: [f64; 3]| -> Vec<(usize, f64)> { (0..3).map(|c| (first + c, row[c])).collect() };
        let now = |row: [f64; 3]| (0..3).map(|c| row[c] * start[c]).sum::<f64>();
        let row = std::array::from_fn(mean);
        problem.add(&at(row), now(row), square);
        for own in 0..3 {
            let row = std::array::from_fn(|c| if c == own { relative[c] } else { 0.0 } - mean(c));
            problem.add(&at(row), now(row), COLOR_PULL * COLOR_PULL * square);
        }
    }
}

/// Solves, brings lights back that are more colorful, darker or brighter than allowed, and solves again with these as they are
/// then: limits of saturation and of luminance are no bounds of a single unknown.
fn within_limits(
    freedom: Freedom,
    unknowns: &[Unknown],
    layout: &Layout,
    mut solve: impl FnMut(&[[f64; 2]]) -> Result<Vec<f64>>,
) -> Result<Vec<f64>> {
    let mut bounds = layout.bounds.clone();
    let mut x = solve(&bounds)?;
    let Freedom::Color { most_saturation } = freedom else { return Ok(x) };
    for round in 0..=MOST_ROUNDS {
        let mut is_new = false;
        for light in (0..unknowns.len()).filter(|light| unknowns[*light].is_colored) {
            let at = layout.first[light]..layout.first[light + 1];
            let rgb: [f64; 3] = std::array::from_fn(|c| x[at.start + c]);
            if let Some(allowed) = brought_back(rgb, &unknowns[light], most_saturation, layout.limits[light]) {
                bounds[at.clone()].iter_mut().zip(allowed).for_each(|(bound, x)| *bound = [x, x]);
                x[at].copy_from_slice(&allowed);
                is_new = true;
            }
        }
        if !is_new || round == MOST_ROUNDS {
            break;
        }
        x = solve(&bounds)?;
    }
    Ok(x)
}

/// The light nearby that is within the limits, if one is not.
fn brought_back(rgb: [f64; 3], unknown: &Unknown, most_saturation: f64, [least, most]: [f64; 2]) -> Option<[f64; 3]> {
    // A light that was more colorful from the start may stay so.
    let own = unknown.color.to_array().map(f64::from);
    let most_saturation = most_saturation.max(saturation(own));
    let is_gaudy = saturation(rgb) > most_saturation + 1e-6;
    let toned = if is_gaudy { toned_down(rgb, most_saturation) } else { rgb };
    let now = luminance(toned);
    if now < least - 1e-9 * least {
        // With light of its own color, so that it becomes no more colorful than either.
        let more = (least - now) / luminance(own);
        return Some(std::array::from_fn(|c| toned[c] + more * own[c]));
    }
    if now > most + 1e-9 * most {
        return Some(toned.map(|x| x * most / now));
    }
    is_gaudy.then_some(toned)
}

/// One minus the least channel over the largest; 0 for black.
fn saturation(rgb: [f64; 3]) -> f64 {
    let (least, most) = (rgb.iter().fold(f64::INFINITY, |a, b| a.min(*b)), rgb.iter().fold(0.0f64, |a, b| a.max(*b)));
    if most > 0.0 { 1.0 - least / most } else { 0.0 }
}

/// The color of a saturation on the way to white of the same luminance.
fn toned_down(rgb: [f64; 3], wanted: f64) -> [f64; 3] {
    let white = luminance(rgb);
    let (least, most) = (rgb.iter().fold(f64::INFINITY, |a, b| a.min(*b)), rgb.iter().fold(0.0f64, |a, b| a.max(*b)));
    // (least + t (white − least)) = (1 − wanted) (most + t (white − most))
    let t = ((1.0 - wanted) * most - least) / ((white - least) - (1.0 - wanted) * (white - most));
    rgb.map(|x| x + t.clamp(0.0, 1.0) * (white - x))
}

fn outcome(mean: &Mean, x: &[f64], layout: &Layout, bounds: [f64; 2], units: Units) -> Outcome {
    let reached = luminance(layout.value(&mean.row, x));
    let unit = if matches!(mean.wish.place, Place::Grid(_)) { "lx" } else { mean.wish.target.unit(units) };
    Outcome::of_mean((&mean.wish.name, unit), [mean.wanted, mean.before, reached], layout.range(&mean.row), bounds)
}

/// Root mean square of how far the wishes are missed, each over what is wanted and by its weight.
fn misfit(outcomes: &[Outcome], weights: &[f64]) -> f64 {
    let squares = outcomes.iter().zip(weights).map(|(outcome, weight)| weight * outcome.miss().powi(2));
    let (sum, weights) = (squares.sum::<f64>(), weights.iter().sum::<f64>());
    if weights > 0.0 { (sum / weights).sqrt() } else { 0.0 }
}

/// What a designer should know about the answer.
fn notes(scene: &Scene, request: &Request, film: Film) -> Vec<String> {
    let mut notes: Vec<String> = Vec::new();
    let shines = |key: &str| !scene.rig.setting(key).muted;
    let unknown_lamps =
        scene.rig.lamps.iter().filter(|lamp| shines(&lamp.key) && !scene.lamps.iter().any(|l| l.key == lamp.key));
    notes.extend(unknown_lamps.map(|lamp| format!("the light of `{}` is not known here: it counts as dark", lamp.key)));
    let set_of = |wish: &Wish| match (&wish.place, &wish.target) {
        (Place::Grid(set), _) => Some(*set),
        (_, Target::Illuminance(_)) => scene.bake.pixel_irradiance(),
        _ => None,
    };
    let is_partly = |set: usize| {
        scene.bake.header.patches.is_some() && !scene.bake.header.holds_patches(&scene.bake.irradiance[set])
    };
    if !scene.lamps.is_empty() && request.wishes.iter().filter_map(set_of).any(is_partly) {
        notes.push("of free lamps wishes for lux count the direct light only: bake again".into());
    }
    if !scene.lamps.is_empty() && scene.bake.header.patches.is_none() {
        notes.push("free lamps count with their direct light only: the bake has no patches".into());
    }
    for wish in &request.wishes {
        if let Target::Picture(picture, exposure) = &wish.target {
            notes.extend(picture.remark(film));
            if picture.was_encoded() && *exposure != Exposure::Free {
                notes.push(format!("{} is display-encoded; its exposure is taken as given", picture.name));
            }
        }
    }
    notes
}
