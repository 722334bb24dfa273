//! Light that patches send each other, and what a receiver takes of them.
//!
//! Rows are sparse: where walks of a receiver landed. What a landing sends back of the patch's *irradiance*, direct and
//! indirect, is `known`; what a narrow lobe sends back of light that comes straight from lamps is `straight`, as if it
//! were broad: the rest of what it sends is found by the walk that goes on. What is found anew of such light is taken off there.

use glam::Vec3;
use rayon::prelude::*;

use super::nearest::Nearest;
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

    /// Divides all by a number of walks, and joins what came of the same patch.
    pub fn finish(&mut self, walks: f32) {
        for shares in [&mut self.known, &mut self.straight] {
            shares.sort_by_key(|share| share.patch);
            shares.dedup_by(|next, kept| {
                let same = next.patch == kept.patch;
                if same {
                    kept.weight += next.weight;
                }
                same
            });
            shares.iter_mut().for_each(|share| share.weight /= walks);
        }
    }

    /// Adds weighted rows of a table with one row per patch, given what makes a number of a color.
    fn add(shares: &[Share], table: &[f32], weigh: impl Fn(Vec3) -> f32, out: &mut [f32]) {
        for share in shares {
            let light = &table[share.patch as usize * out.len()..][..out.len()];
            let weight = weigh(share.weight);
            out.iter_mut().zip(light).for_each(|(out, light)| *out += weight * light);
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
                integrator.land_from_surface(origin, &mut sampler, &mut |landing, sampler| {
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
        let len = direct.len() / self.rows.len().max(1);
        let first = sweep([direct, direct], len, |patch| &self.rows[patch].straight, tint);
        let (mut light, mut bounces, mut last) = (first.clone(), Bounces::default(), 0.0);
        while bounces.followed < self.most_bounces {
            let next = sweep([&first, &light], len, |patch| &self.rows[patch].known, tint);
            let before = std::mem::replace(&mut light, next);
            let change = distance(&light, &before);
            bounces.followed += 1;
            let is_last = bounces.followed == MOST_SWEEPS || change <= SETTLED * distance(&light, &first);
            if is_last && bounces.followed < self.most_bounces {
                bounces.tail = tail(change, last);
                extrapolate(&mut light, &before, bounces.tail);
                break;
            }
            last = change;
        }
        (light, bounces)
    }

    /// What receivers take of light straight from lamps, by all ways, given what they take of all light of patches and of
    /// such light alone: rows are patches, as in [`Exchange::solve`], of which this is the transpose for the same bounces.
    pub fn solve_transposed(&self, [known, straight]: [&[f32]; 2], bounces: Bounces, tint: Tint) -> Vec<f32> {
        let len = known.len() / self.rows.len().max(1);
        let (by_known, by_straight) = (self.transposed(|row| &row.known), self.transposed(|row| &row.straight));
        let (mut taken, mut before) = (known.to_vec(), Vec::new());
        for _ in 0..bounces.followed {
            let next = sweep([known, &taken], len, |patch| &by_known[patch], tint);
            before = std::mem::replace(&mut taken, next);
        }
        extrapolate(&mut taken, &before, bounces.tail);
        let mut out = sweep([&taken, &taken], len, |patch| &by_straight[patch], tint);
        out.iter_mut().zip(straight).for_each(|(out, straight)| *out += straight);
        out
    }

    fn transposed(&self, of: impl Fn(&Row) -> &Vec<Share>) -> Vec<Vec<Share>> {
        let mut out = vec![Vec::new(); self.rows.len()];
        for (patch, row) in (0u32..).zip(&self.rows) {
            for share in of(row) {
                out[share.patch as usize].push(Share { patch, ..*share });
            }
        }
        out
    }
}

/// `base + shares · light`, rows of `len` numbers, given the shares of each patch.
fn sweep<'a>([base, light]: [&[f32]; 2], len: usize, of: impl Fn(usize) -> &'a [Share] + Sync, tint: Tint) -> Vec<f32> {
    let mut out = base.to_vec();
    let rows = out.par_chunks_mut(len.max(1)).enumerate();
    rows.for_each(|(patch, out)| Row::add(of(patch), light, |color| tint.of(color), out));
    out
}

/// What rows take of light, given all of it and what of it comes straight from lamps.
pub(super) fn taken(rows: &[Row], [all, straight]: [&[f32]; 2], len: usize, tint: Tint) -> Vec<f32> {
    let mut out = vec![0.0; rows.len() * len];
    out.par_chunks_mut(len.max(1)).zip(rows).for_each(|(out, row)| {
        Row::add(&row.known, all, |color| tint.of(color), out);
        Row::add(&row.straight, straight, |color| tint.of(color), out);
    });
    out
}

/// What all bounces after the last bring, as a multiple of it, given the sizes of the last two.
fn tail(last: f64, one_before: f64) -> f32 {
    let left = (last / one_before).min(MOST_LEFT);
    if left.is_finite() { (left / (1.0 - left)) as f32 } else { 0.0 }
}

/// Adds what changed, so many times more.
fn extrapolate(light: &mut [f32], before: &[f32], times: f32) {
    light.par_iter_mut().zip(before).for_each(|(x, before)| *x += times * (*x - before));
}

/// Sum of the sizes of differences.
fn distance(a: &[f32], b: &[f32]) -> f64 {
    let part = |(a, b): (&[f32], &[f32])| a.iter().zip(b).map(|(a, b)| f64::from((a - b).abs())).sum::<f64>();
    // Summed in order, so that threads do not change it.
    a.par_chunks(4096).zip(b.par_chunks(4096)).map(part).collect::<Vec<_>>().iter().sum()
}
