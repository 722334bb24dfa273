//! Rows of neighboring pixels, sampled together so that they share their walks.

use std::ops::Range;

use clerestory_nystrom::{Half, SparseEntry};
use glam::Vec3;

use super::hand_out::HandOut;
use super::{CHANNELS, RowDeposit, TransportMatrix};
use crate::camera::Film;
use crate::path::{Meeting, Scratch, Start};
use crate::plan::along_morton;

/// Side of the squares of pixels that share walks; a power of two that divides the side of a block.
const TILE: u64 = 8;
/// Light that is handed out at once.
const BATCH: usize = 64;

/// Buffers of a thread.
#[derive(Default)]
struct Buffers {
    scratch: Scratch,
    starts: Vec<Start>,
    meetings: Vec<Meeting>,
    /// What each start gets of one meeting.
    shares: Vec<Vec3>,
    shared: Shared,
}

/// Light of some meetings, and who gets how much of it: see [`HandOut`].
#[derive(Default)]
struct Shared {
    light: Vec<f32>,
    shares: Vec<[f32; CHANNELS]>,
    receivers: Vec<usize>,
    n: usize,
}

impl TransportMatrix<'_> {
    /// Adds samples of pixels as [`clerestory_nystrom::SampledMatrix::add_rows`] does. Those in the same tile of the picture
    /// share their walks.
    pub(super) fn add_pixels(
        &self,
        bundles: &[u32],
        samples: Range<u32>,
        half: Half,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
    ) {
        let mut order: Vec<(u64, usize)> = bundles.iter().map(|pixel| place(self.film, *pixel)).zip(0..).collect();
        order.sort_unstable();
        let mut buffers = Buffers::default();
        for tile in order.chunk_by(|a, b| tile(a.0) == tile(b.0)) {
            for sample in samples.clone() {
                buffers.starts.clear();
                for &(_, nth) in tile {
                    self.set_out((bundles[nth], nth), (sample, half), out, sparse, &mut buffers);
                }
                self.share_walks(out, sparse, &mut buffers);
            }
        }
    }

    /// Samples what the `nth` pixel sees, and the light that falls straight on it.
    fn set_out(
        &self,
        (pixel, nth): (u32, usize),
        (sample, half): (u32, Half),
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
        Buffers { scratch, starts, .. }: &mut Buffers,
    ) {
        let mut sampler = self.sampler(pixel, half, sample);
        let (_, ray) = self.sample_ray(pixel, &mut sampler);
        let mut deposit = self.deposit_of(nth, out);
        if self.is_empty_pixel(pixel) {
            self.integrator.pass_by(ray, &mut deposit);
        } else {
            starts.extend(self.integrator.set_out(ray, nth, sampler, scratch, &mut deposit));
        }
        sparse.append(&mut deposit.into_sparse());
    }

    /// Follows the walks of all starts and gives each start its share.
    fn share_walks(
        &self,
        out: &mut [f32],
        sparse: &mut Vec<SparseEntry>,
        Buffers { scratch, starts, meetings, shares, shared }: &mut Buffers,
    ) {
        let n_cols = self.column_scale.len();
        for (number, start) in starts.iter().enumerate() {
            let mut deposit = self.deposit_of(start.place, out);
            meetings.extend(self.integrator.explore((number, start), scratch, &mut deposit));
            sparse.append(&mut deposit.into_sparse());
        }
        shared.receivers.clear();
        shared.receivers.extend(starts.iter().map(|start| start.place));
        for meeting in meetings.drain(..) {
            if !self.integrator.share(&meeting, starts, shares) {
                let mut deposit = self.deposit_of(starts[meeting.start].place, out);
                self.integrator.follow_alone(meeting, scratch, &mut deposit);
                continue;
            }
            let mut own = self.deposit_of(starts[meeting.start].place, out);
            self.integrator.follow_rest(&meeting, scratch, &mut own);
            let mut deposit = RowDeposit::new(shared.next_light(CHANNELS * n_cols), n_cols, &self.column_scale);
            let factor = self.integrator.follow_shared(meeting, scratch, &mut deposit);
            shared.shares.extend(shares.iter().map(|share| (*share / factor).to_array()));
            if shared.n == BATCH {
                shared.hand_out(n_cols, out);
            }
        }
        shared.hand_out(n_cols, out);
    }

    /// Takes what the walks of the `nth` pixel find.
    fn deposit_of<'d>(&'d self, nth: usize, out: &'d mut [f32]) -> RowDeposit<'d> {
        let (n_cols, first_row) = (self.column_scale.len(), nth * CHANNELS);
        let rows = &mut out[first_row * n_cols..][..CHANNELS * n_cols];
        RowDeposit::new(rows, n_cols, &self.column_scale).with_first_row(first_row as u32)
    }
}

/// Where a pixel comes among all, those of a tile in a row.
fn place(film: Film, pixel: u32) -> u64 {
    along_morton([pixel % film.width, pixel / film.width])
}

/// The tile of a place.
fn tile(place: u64) -> u64 {
    place / (TILE * TILE)
}

/// Pixels of a picture by the tiles in which they share walks.
pub(super) fn tiles_of(film: Film, pixels: impl Iterator<Item = u32>) -> Vec<Vec<u32>> {
    let mut pixels: Vec<u32> = pixels.collect();
    pixels.sort_unstable_by_key(|pixel| place(film, *pixel));
    let of_tile = pixels.chunk_by(|a, b| tile(place(film, *a)) == tile(place(film, *b)));
    of_tile.map(<[u32]>::to_vec).collect()
}

impl Shared {
    /// Three dark rows for one more meeting.
    fn next_light(&mut self, len: usize) -> &mut [f32] {
        self.n += 1;
        self.light.resize(self.n * len, 0.0);
        &mut self.light[(self.n - 1) * len..]
    }

    /// Adds the light to the rows of the starts and forgets it.
    fn hand_out(&mut self, n_cols: usize, out: &mut [f32]) {
        HandOut { light: &self.light, shares: &self.shares, receivers: &self.receivers, n_cols }.add_to(out);
        self.light.clear();
        self.shares.clear();
        self.n = 0;
    }
}
