//! Light that patches send each other, and what a receiver takes of them.
//!
//! Rows are sparse: where walks of a receiver landed. What a landing sends back of the patch's *irradiance*, direct and
//! indirect, is `known`; what a narrow lobe sends back of light that comes straight from lamps is `straight`, as if it
//! were broad: the rest of what it sends is found by the walk that goes on. What is found anew of such light is taken off there.

use glam::Vec3;
use rayon::prelude::*;

use super::nearest::Nearest;
use super::strips::{Link, Strips};
use crate::path::{Integrator, Landing, NoLights, Onward};
use crate::sampler::Sampler;

/// A share of the light of a patch.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Share {
    pub patch: u32,
    pub weight: Vec3,
}

/// What somebody takes of the light of patches.
#[derive(Clone, Debug, Default)]
pub(super) struct Row {
    /// Of all light that a patch receives.
    pub known: Vec<Share>,
    /// Of the light that it receives straight from lamps.
    pub straight: Vec<Share>,
}

impl Row {
    /// Takes a landing.
    pub fn land(&mut self, nearest: &Nearest, landing: &Landing<'_>, sampler: &mut Sampler) -> Onward {
        let (shares, throughput) = (landing.shares, landing.throughput);
        let u = sampler.next_1d();
        if let Some(patch) = nearest.draw(landing.hit.position, landing.normal, u) {
            let push = |to: &mut Vec<Share>, weight: Vec3| {
                if weight != Vec3::ZERO {
                    to.push(Share { patch, weight: weight * throughput });
                }
            };
            push(&mut self.known, shares.base);
            push(&mut self.straight, shares.narrow * (Vec3::ONE - landing.anew) - shares.base * landing.anew);
        }
        if shares.behind != Vec3::ZERO
            && let Some(patch) = nearest.draw(landing.hit.position, -landing.normal, u)
        {
            self.straight.push(Share { patch, weight: shares.behind * (Vec3::ONE - landing.anew) * throughput });
        }
        Onward::Narrow
    }

    /// Forgets all that was taken.
    pub fn clear(&mut self) {
        self.known.clear();
        self.straight.clear();
    }

    /// Divides all by a number, that of walks for one, and joins what came of the same patch.
    pub fn finish(&mut self, divisor: f32) {
        for shares in [&mut self.known, &mut self.straight] {
            shares.sort_by_key(|share| share.patch);
            shares.dedup_by(|next, kept| {
                let same = next.patch == kept.patch;
                if same {
                    kept.weight += next.weight;
                }
                same
            });
            shares.iter_mut().for_each(|share| share.weight /= divisor);
        }
    }
}

/// Rows of all patches.
pub(super) struct Exchange {
    rows: Vec<Row>,
    /// Bounces between patches that a path may have.
    most_bounces: u32,
}

/// Bounces between patches that count.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Bounces {
    /// Those that are followed one by one.
    followed: u32,
    /// All later ones, as a multiple of the last that was followed.
    tail: f32,
}

/// Bounces that are followed at most.
const MOST_SWEEPS: u32 = 24;
/// Share of all light from other patches that the last of the bounces followed brings: by then each bounce is as the one before,
/// but weaker.
const SETTLED: f64 = 0.01;
/// A bounce brings at most this share of what the one before brought, as far as later ones are concerned.
const MOST_LEFT: f64 = 0.98;
/// Walks from each patch.
const WALKS: u32 = 128;

/// Which of the three colors of the exchange, or all three alike.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Tint {
    /// The mean of all.
    Gray,
    /// Red, green or blue.
    Channel(usize),
}

impl Tint {
    pub fn of(self, color: Vec3) -> f32 {
        match self {
            Tint::Gray => color.element_sum() / 3.0,
            Tint::Channel(channel) => color[channel],
        }
    }
}

impl Exchange {
    /// Follows walks from the points of each patch.
    pub fn find(
        integrator: &Integrator<'_, NoLights>,
        nearest: &Nearest,
        origins: &[Vec<(Vec3, Vec3)>],
        (seed, stream): (u64, u64),
    ) -> Exchange {
        let row = |(patch, origins): (usize, &Vec<(Vec3, Vec3)>)| {
            let mut row = Row::default();
            for walk in 0..WALKS {
                let mut sampler = Sampler::new(seed, stream + patch as u64, walk);
                let origin = origins[walk as usize % origins.len()];
                // Whoever looks at a patch does so from a surface.
                integrator.land_from_surface(origin, 1, &mut sampler, &mut |landing, sampler| {
                    row.land(nearest, landing, sampler)
                });
            }
            row.finish(WALKS as f32);
            row
        };
        let rows = origins.par_iter().enumerate().map(row).collect();
        // The first landing of a camera's walk is one scattering beyond the first.
        Exchange { rows, most_bounces: integrator.bounces().saturating_sub(1) }
    }

    /// All light that patches receive, given what comes straight from lamps: rows of `direct` are patches. And which
    /// bounces between patches that counts.
    pub fn solve(&self, direct: &[f32], tint: Tint) -> (Vec<f32>, Bounces) {
        let direct = Strips::of(direct, direct.len() / self.rows.len().max(1));
        let first = direct.plus(&linked(&self.rows, |row| &row.straight, tint), &direct);
        let known = linked(&self.rows, |row| &row.known, tint);
        let (mut light, mut bounces, mut last) = (first.clone(), Bounces::default(), 0.0);
        while bounces.followed < self.most_bounces {
            let next = first.plus(&known, &light);
            let before = std::mem::replace(&mut light, next);
            let change = light.distance(&before);
            bounces.followed += 1;
            let is_last = bounces.followed == MOST_SWEEPS || change <= SETTLED * light.distance(&first);
            if is_last && bounces.followed < self.most_bounces {
                bounces.tail = tail(change, last);
                light.extrapolate(&before, bounces.tail);
                break;
            }
            last = change;
        }
        (light.row_major(), bounces)
    }

    /// What receivers take of light straight from lamps, by all ways, given what they take of all light of patches and of
    /// such light alone: rows are patches, as in [`Exchange::solve`], of which this is the transpose for the same bounces.
    pub fn solve_transposed(&self, [known, straight]: [&[f32]; 2], bounces: Bounces, tint: Tint) -> Vec<f32> {
        let known = Strips::of(known, known.len() / self.rows.len().max(1));
        let by_known = self.transposed(|row| &row.known, tint);
        let (mut taken, mut before) = (known.clone(), Strips::default());
        for _ in 0..bounces.followed {
            let next = known.plus(&by_known, &taken);
            before = std::mem::replace(&mut taken, next);
        }
        taken.extrapolate(&before, bounces.tail);
        let mut out = taken.plus(&self.transposed(|row| &row.straight, tint), &taken).row_major();
        out.iter_mut().zip(straight).for_each(|(out, straight)| *out += straight);
        out
    }

    fn transposed(&self, of: impl Fn(&Row) -> &Vec<Share>, tint: Tint) -> Vec<Vec<Link>> {
        let mut out = vec![Vec::new(); self.rows.len()];
        for (patch, row) in (0u32..).zip(&self.rows) {
            for share in of(row) {
                out[share.patch as usize].push((patch, tint.of(share.weight)));
            }
        }
        out
    }
}

/// Shares of rows as sums of rows of a table that has one for each patch.
fn linked(rows: &[Row], of: impl Fn(&Row) -> &Vec<Share>, tint: Tint) -> Vec<Vec<Link>> {
    let link = |share: &Share| (share.patch, tint.of(share.weight));
    rows.iter().map(|row| of(row).iter().map(link).collect()).collect()
}

/// What rows take of light, given all of it and what of it comes straight from lamps.
pub(super) fn taken(rows: &[Row], [all, straight]: [&[f32]; 2], len: usize, tint: Tint) -> Vec<f32> {
    let known = Strips::zeros(rows.len(), len).plus(&linked(rows, |row| &row.known, tint), &Strips::of(all, len));
    known.plus(&linked(rows, |row| &row.straight, tint), &Strips::of(straight, len)).row_major()
}

/// What all bounces after the last bring, as a multiple of it, given the sizes of the last two; nothing after one that brought nothing.
fn tail(last: f64, one_before: f64) -> f32 {
    if last <= 0.0 {
        return 0.0;
    }
    let left = (last / one_before).min(MOST_LEFT);
    (left / (1.0 - left)) as f32
}

#[cfg(test)]
mod tests {
    use super::super::nearest::Center;
    use super::*;
    use crate::camera::Camera;
    use crate::laws::stage::{Stage, lambert, room};
    use crate::sampler::uniform_hash;

    const PATCHES: usize = 40;
    const LAMPS: usize = 19;
    const PIXELS: usize = 5;

    fn numbers(n: usize, key: u64) -> Vec<f32> {
        (0..n as u64).map(|nth| uniform_hash(key + nth)).collect()
    }

    /// A row of shares whose sum is about `whole`.
    fn shares(n: u64, whole: f32, key: u64) -> Vec<Share> {
        let weight = |key: u64| Vec3::from_slice(&numbers(3, key)) * (2.0 * whole / n as f32);
        let patch = |key: u64| (uniform_hash(key) * PATCHES as f32) as u32;
        (0..n).map(|nth| Share { patch: patch(key + 4 * nth), weight: weight(key + 4 * nth + 1) }).collect()
    }

    fn rows(n: usize, key: u64) -> Vec<Row> {
        let row = |nth: u64| {
            let key = key + 1000 * nth;
            Row { known: shares(12, 0.6, key), straight: shares(4, 0.1, key + 500) }
        };
        (0..n as u64).map(row).collect()
    }

    #[test]
    fn light_that_is_solved_for_is_what_patches_send_on() {
        let exchange = Exchange { rows: rows(PATCHES, 100_000), most_bounces: u32::MAX };
        let direct = numbers(PATCHES * LAMPS, 1);
        for tint in [Tint::Gray, Tint::Channel(1)] {
            let (light, _) = exchange.solve(&direct, tint);
            for (at, found) in light.iter().enumerate() {
                let (patch, lamp) = (at / LAMPS, at % LAMPS);
                let of = |shares: &[Share], light: &[f32]| -> f32 {
                    shares.iter().map(|s| tint.of(s.weight) * light[s.patch as usize * LAMPS + lamp]).sum()
                };
                let row = &exchange.rows[patch];
                let expected = direct[at] + of(&row.straight, &direct) + of(&row.known, &light);
                assert!((found / expected - 1.0).abs() < 0.01, "{tint:?}: {found} for {expected}");
            }
        }
    }

    #[test]
    fn pixels_take_of_light_what_its_transpose_says() {
        let pixels = rows(PIXELS, 900_000);
        for most_bounces in [0, 2, u32::MAX] {
            let exchange = Exchange { rows: rows(PATCHES, 100_000), most_bounces };
            let direct = numbers(PATCHES * LAMPS, 1);
            let (light, bounces) = exchange.solve(&direct, Tint::Gray);
            let pictures = taken(&pixels, [&light, &direct], LAMPS, Tint::Gray);
            let gathered = |of: fn(&Row) -> &Vec<Share>| {
                let mut out = vec![0.0; PATCHES * PIXELS];
                for (pixel, row) in pixels.iter().enumerate() {
                    for share in of(row) {
                        out[share.patch as usize * PIXELS + pixel] += Tint::Gray.of(share.weight);
                    }
                }
                out
            };
            let (known, straight) = (gathered(|row| &row.known), gathered(|row| &row.straight));
            let transposed = exchange.solve_transposed([&known, &straight], bounces, Tint::Gray);
            for (at, found) in pictures.iter().enumerate() {
                let (pixel, lamp) = (at / LAMPS, at % LAMPS);
                let term = |patch: usize| transposed[patch * PIXELS + pixel] * direct[patch * LAMPS + lamp];
                let expected: f32 = (0..PATCHES).map(term).sum();
                assert!((found / expected - 1.0).abs() < 1e-4, "{most_bounces} bounces: {found} for {expected}");
            }
        }
    }

    #[test]
    fn a_bounce_that_brings_nothing_is_followed_by_none() {
        let row = |known: Vec<Share>| Row { known, straight: Vec::new() };
        let of_second = vec![Share { patch: 1, weight: Vec3::splat(0.5) }];
        let exchange = Exchange { rows: vec![row(of_second), row(Vec::new())], most_bounces: u32::MAX };
        // Lamps that were tried light the first patch alone, of which nobody takes anything.
        let (light, bounces) = exchange.solve(&[1.0, 0.0], Tint::Gray);
        assert_eq!(light, [1.0, 0.0]);
        // Who sees the first patch alone sees half of what comes to the second one.
        let taken = exchange.solve_transposed([&[1.0, 0.0], &[0.0, 0.0]], bounces, Tint::Gray);
        assert_eq!(taken, [1.0, 0.5]);
    }

    #[test]
    fn patches_send_each_other_nothing_where_one_bounce_is_all() {
        let camera = Camera::look_at("eye", Vec3::Z * 0.5, Vec3::ZERO, 1.0, 1.0);
        let scene = Stage::new(camera).surface("walls", &room(Vec3::ONE), lambert(0.6, 0.0)).prepared();
        let nearest = Nearest::new(vec![Center { position: Vec3::NEG_Y, normal: Vec3::Y }], 0.1);
        let n_shares = |bounces| {
            let integrator = Integrator::new(&scene, &NoLights, Some(bounces));
            let origins = [vec![(Vec3::Y * -0.999, Vec3::Y)]];
            Exchange::find(&integrator, &nearest, &origins, (1, 0)).rows[0].known.len()
        };
        assert_eq!([1, 2].map(n_shares), [0, 1]);
    }
}
