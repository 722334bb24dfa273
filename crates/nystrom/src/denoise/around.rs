//! Weighted means over what lies around each bundle of a tile: sums along rows of the grid, so that vectors run over bundles.
#![cfg_attr(
    target_arch = "x86_64",
    expect(
        unsafe_code,
        reason = "calls of what is compiled for AVX2 and FMA, behind run-time detection; the same safe code without"
    )
)]

use std::{array, ops::Range};

use crate::partition::Partition;

use super::{LEAST_LIKENESS, Likeness, N_MIXED, REACHES};

/// Bundles that are summed for side by side.
const LANES: usize = 8;
/// Planes that are summed at a time.
const PLANES: usize = 6;
/// Numbers of a cache line.
pub(super) const CACHE_LINE: usize = 16;
/// Bundles around a tile to each side that its means are made of.
const REACH: usize = REACHES[2] as usize;
/// Places across and down that the largest mean is made of.
const SPAN: usize = 2 * REACH + 1;

/// One number for each bundle.
type Lanes = [f32; LANES];

/// A tile with all that is within reach of it; what lies beyond the grid is there and alike to nothing.
pub(super) struct Window {
    /// First column, first row, width and height of the tile.
    tile: [usize; 4],
    /// Places of a row: those of the tile rounded up to whole [`LANES`], and the reach to both sides.
    stride: usize,
    n_rows: usize,
}

impl Window {
    fn new(tile: [u32; 4]) -> Self {
        let [x, y, width, height] = tile.map(|side| side as usize);
        let (stride, n_rows) = (width.next_multiple_of(LANES) + 2 * REACH, height + 2 * REACH);
        Self { tile: [x, y, width, height], stride, n_rows }
    }

    /// What is within reach of another tile (first column, first row, width and height) of a grid so wide, line by line.
    pub(super) fn lines(&self, [x0, y0, width, height]: [u32; 4], grid_width: u32) -> Vec<Line> {
        let [left, top, ..] = self.tile;
        let column = |x: u32| (x as usize + REACH).wrapping_sub(left);
        let line = |y: u32| {
            let row = (y as usize + REACH).checked_sub(top).filter(|row| *row < self.n_rows)?;
            let mut within = (x0..x0 + width).filter(|x| column(*x) < self.stride);
            let first = within.next()?;
            let nth = ((y - y0) * width + first - x0) as usize;
            let place = row * self.stride + column(first);
            Some(Line { place, bundle: y * grid_width + first, nth: nth..nth + 1 + within.count() })
        };
        (y0..y0 + height).filter_map(line).collect()
    }

    /// Bundles of the tile.
    pub(super) fn n_bundles(&self) -> usize {
        self.tile[2] * self.tile[3]
    }

    /// Lanes of a row of the tile.
    fn n_lanes(&self) -> usize {
        (self.stride - 2 * REACH) / LANES
    }
}

/// Bundles of another tile side by side.
pub(super) struct Line {
    /// Of the first one in the window.
    pub(super) place: usize,
    /// The first one, of all of the grid.
    pub(super) bundle: u32,
    /// Which ones of their tile.
    pub(super) nth: Range<usize>,
}

/// How alike each bundle of a tile is to those around.
pub(super) struct Alike {
    pub(super) window: Window,
    /// One for each row of the tile.
    rows: Vec<Row>,
}

/// What a row of the tile is held against.
#[derive(Default)]
struct Row {
    /// Places from that of the row's first bundle less the reach, the nearest first; those alike to no bundle of the row are left out.
    places: Vec<usize>,
    /// Of each place one for each bundle of the row.
    weights: Vec<Lanes>,
    /// Places that each mean is made of.
    n_within: [usize; N_MIXED],
}

impl Alike {
    pub(super) fn new(partition: &Partition, block_idx: usize, likeness: &impl Likeness) -> Self {
        let window = Window::new(partition.rect(block_idx));
        let rows = (0..window.tile[3]).map(|y| Row::new(&window, y, partition, likeness)).collect();
        Alike { window, rows }
    }
}

impl Row {
    fn new(window: &Window, y: usize, partition: &Partition, likeness: &impl Likeness) -> Self {
        let ([left, top, width, _], grid) = (window.tile, [partition.width as usize, partition.height as usize]);
        let (n_lanes, mut row) = (window.n_lanes(), Row::default());
        // Of each bundle of the row those around that are there, line by line.
        let mut likenesses = vec![[[0.0; SPAN]; SPAN]; width];
        for (x, around) in likenesses.iter_mut().enumerate() {
            let (own_x, own_y) = (left + x, top + y);
            let (first, last) = (own_x.saturating_sub(REACH), grid[0].min(own_x + REACH + 1));
            let within = first + REACH - own_x..last + REACH - own_x;
            for (down, line) in around.iter_mut().enumerate() {
                let other_y = (own_y + down).wrapping_sub(REACH);
                if other_y < grid[1] {
                    let (bundle, other) = ((own_y * grid[0] + own_x) as u32, (other_y * grid[0] + first) as u32);
                    likeness.likeness(bundle, other, &mut line[within.clone()]);
                }
            }
        }
        let mut within = 0..0;
        for (reach, n_within) in [0].iter().chain(&REACHES).zip(&mut row.n_within) {
            let inner = within;
            within = REACH - *reach as usize..REACH + *reach as usize + 1;
            for (down, across) in within.clone().flat_map(|down| within.clone().map(move |across| (down, across))) {
                if inner.contains(&down) && inner.contains(&across) {
                    continue;
                }
                let weights = likenesses.iter().map(|around| around[down][across]);
                let weights = weights.map(|weight| if weight > LEAST_LIKENESS { weight } else { 0.0 });
                if weights.clone().any(|weight| weight > 0.0) {
                    row.places.push(down * window.stride + across);
                    let first = row.weights.len();
                    row.weights.resize(first + n_lanes, Lanes::default());
                    row.weights[first..]
                        .as_flattened_mut()
                        .iter_mut()
                        .zip(weights)
                        .for_each(|(to, weight)| *to = weight);
                }
            }
            *n_within = row.places.len();
        }
        row
    }
}

/// Values of all bundles of a window, plane by plane.
pub(super) struct Planes {
    /// Planes × places of the window; unknown bundles are 0 in all.
    data: Vec<f32>,
    /// 1 where a bundle is known.
    known: Vec<f32>,
    n_values: usize,
    n_places: usize,
}

impl Planes {
    /// Nothing is known yet.
    pub(super) fn new(window: &Window, n_values: usize) -> Self {
        // Planes an odd number of cache lines apart do not push each other out of the cache.
        let n_places = (window.stride * window.n_rows).next_multiple_of(CACHE_LINE) | CACHE_LINE;
        let data = vec![0.0; n_values.next_multiple_of(PLANES) * n_places];
        Planes { data, known: vec![0.0; n_places], n_values, n_places }
    }

    /// Tells some values of bundles side by side, of each those from a value on. A few at a time are fast: each lies in a plane of its own.
    pub(super) fn set<'a>(&mut self, value: usize, place: usize, bundles: impl Iterator<Item = &'a [f32]>) {
        let first = value * self.n_places + place;
        for (nth, values) in bundles.enumerate() {
            let planes = self.data[first + nth..].iter_mut().step_by(self.n_places);
            planes.zip(values).for_each(|(to, value)| *to = *value);
        }
    }

    /// Tells which of the bundles side by side are known; all values of the others are 0.
    pub(super) fn set_known(&mut self, place: usize, known: impl Iterator<Item = bool>) {
        self.known[place..].iter_mut().zip(known).for_each(|(to, known)| *to = f32::from(u8::from(known)));
    }

    /// The values of the bundles of a tile as they are, and their three means.
    pub(super) fn means(&self, alike: &Alike) -> Means {
        let (n_values, n_bundles) = (self.n_values, alike.window.n_bundles());
        let mut means = Means { data: vec![0.0; N_MIXED * n_values * n_bundles], n_values, n_bundles };
        let mut totals = Vec::new();
        alike.sums([&self.known], |_, _, [total]| totals.push(total));
        let width = alike.window.tile[2];
        for (nth, planes) in self.data.chunks_exact(PLANES * self.n_places).enumerate() {
            let planes = array::from_fn(|plane| &planes[plane * self.n_places..][..self.n_places]);
            let mut totals = totals.iter();
            alike.sums::<PLANES>(planes, |[y, lane], mean, sums| {
                let total = totals.next().expect("as many totals as sums");
                let bundles = y * width + lane * LANES..(y + 1) * width;
                for (value, sums) in (nth * PLANES..n_values).zip(sums) {
                    let out = &mut means.plane_mut(mean, value)[bundles.clone()];
                    for ((out, sum), total) in out.iter_mut().zip(sums).zip(total) {
                        // Around what nothing is known of, sums and totals are 0.
                        *out = sum / total.max(f32::MIN_POSITIVE);
                    }
                }
            });
        }
        means
    }
}

impl Alike {
    /// Sums of what lies around, weighed, plane by plane: for each row of the tile, some bundles of it side by side, and each mean.
    fn sums<const N: usize>(&self, planes: [&[f32]; N], mut out: impl FnMut([usize; 2], usize, [Lanes; N])) {
        let n_lanes = self.window.n_lanes();
        for (y, row) in self.rows.iter().enumerate() {
            for lane in 0..n_lanes {
                let first = y * self.window.stride + lane * LANES;
                let planes = planes.map(|plane| &plane[first..]);
                let (mut sums, mut within) = ([Lanes::default(); N], 0..0);
                for (mean, end) in row.n_within.into_iter().enumerate() {
                    within = within.end..end;
                    let around = Around {
                        places: &row.places[within.clone()],
                        weights: &row.weights[within.start * n_lanes..end * n_lanes],
                        n_lanes,
                        lane,
                    };
                    around.add(planes, &mut sums);
                    out([y, lane], mean, sums);
                }
            }
        }
    }
}

/// Places around some bundles side by side.
struct Around<'a> {
    places: &'a [usize],
    /// Places × lanes of the row.
    weights: &'a [Lanes],
    n_lanes: usize,
    lane: usize,
}

impl Around<'_> {
    /// Adds what lies there, weighed, to the sums of some planes.
    fn add<const N: usize>(&self, planes: [&[f32]; N], sums: &mut [Lanes; N]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma") {
            // SAFETY: AVX2 and FMA were found.
            return unsafe { self.add_avx2(planes, sums) };
        }
        self.add_by(planes, sums, |weight, x, sum| sum + weight * x);
    }

    /// The same up to rounding, eight at a time.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2,fma")]
    fn add_avx2<const N: usize>(&self, planes: [&[f32]; N], sums: &mut [Lanes; N]) {
        self.add_by(planes, sums, f32::mul_add);
    }

    #[inline(always)]
    fn add_by<const N: usize>(
        &self,
        planes: [&[f32]; N],
        sums: &mut [Lanes; N],
        multiply_add: impl Fn(f32, f32, f32) -> f32,
    ) {
        // A copy, and loops instead of closures: sums whose address is taken would live in memory.
        let mut own = *sums;
        for (place, weights) in self.places.iter().zip(self.weights.chunks_exact(self.n_lanes)) {
            let weights = &weights[self.lane];
            for (plane, sums) in planes.iter().zip(&mut own) {
                let values: &Lanes = plane[*place..].first_chunk().expect("a window reaches as far as its places");
                for lane in 0..LANES {
                    sums[lane] = multiply_add(weights[lane], values[lane], sums[lane]);
                }
            }
        }
        *sums = own;
    }
}

/// Values of the bundles of a tile: as they are, then their means.
pub(super) struct Means {
    /// Those that are mixed × values × bundles.
    data: Vec<f32>,
    n_values: usize,
    n_bundles: usize,
}

impl Means {
    /// One value of all bundles of a mean; the first is none but what they are.
    pub(super) fn plane(&self, mean: usize, value: usize) -> &[f32] {
        &self.data[(mean * self.n_values + value) * self.n_bundles..][..self.n_bundles]
    }

    pub(super) fn plane_mut(&mut self, mean: usize, value: usize) -> &mut [f32] {
        &mut self.data[(mean * self.n_values + value) * self.n_bundles..][..self.n_bundles]
    }

    /// A value of all bundles as they are and of its means.
    fn planes(&self, value: usize) -> [&[f32]; N_MIXED] {
        array::from_fn(|mean| self.plane(mean, value))
    }

    /// A mixture of a value of all bundles; `out` is overwritten.
    pub(super) fn mix(&self, value: usize, weights: [f64; N_MIXED], out: &mut Vec<f32>) {
        out.clear();
        out.resize(self.n_bundles, 0.0);
        for (plane, weight) in self.planes(value).into_iter().zip(weights) {
            out.iter_mut().zip(plane).for_each(|(out, x)| *out += x * weight as f32);
        }
    }

    /// Adds the products of each two of what is mixed, over all bundles.
    pub(super) fn add_products(&self, value: usize, gram: &mut [[f64; N_MIXED]; N_MIXED]) {
        let planes = self.planes(value);
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: AVX2 was found.
            return unsafe { add_products_avx2(planes, gram) };
        }
        add_products(planes, gram);
    }
}

/// The same numbers, four at a time.
#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn add_products_avx2(planes: [&[f32]; N_MIXED], gram: &mut [[f64; N_MIXED]; N_MIXED]) {
    add_products(planes, gram);
}

#[inline(always)]
fn add_products(planes: [&[f32]; N_MIXED], gram: &mut [[f64; N_MIXED]; N_MIXED]) {
    /// Numbers in double precision side by side.
    const WIDE: usize = LANES / 2;
    let mut sums = [[[0.0; WIDE]; N_MIXED]; N_MIXED];
    for first in (0..planes[0].len()).step_by(WIDE) {
        let mut values = [[0.0; WIDE]; N_MIXED];
        for (values, plane) in values.iter_mut().zip(planes) {
            match plane[first..].first_chunk::<WIDE>() {
                Some(four) => *values = four.map(f64::from),
                None => values.iter_mut().zip(&plane[first..]).for_each(|(to, x)| *to = f64::from(*x)),
            }
        }
        for i in 0..N_MIXED {
            for j in 0..=i {
                for lane in 0..WIDE {
                    sums[i][j][lane] += values[i][lane] * values[j][lane];
                }
            }
        }
    }
    for i in 0..N_MIXED {
        for j in 0..N_MIXED {
            gram[i][j] += sums[i.max(j)][i.min(j)].iter().sum::<f64>();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::random::Random;

    const N_VALUES: usize = 3;
    const GRID: [u32; 2] = [21, 19];

    /// Any two bundles are alike by chance; each is like itself.
    struct Chance;

    impl Chance {
        fn of(bundle: u32, other: u32) -> f32 {
            let like = Random::new([u64::from(bundle), u64::from(other)]).normal();
            if bundle == other { 1.0 } else { like.clamp(0.0, 1.0) }
        }
    }

    impl Likeness for Chance {
        fn likeness(&self, bundle: u32, first: u32, out: &mut [f32]) {
            (first..).zip(out).for_each(|(other, out)| *out = Chance::of(bundle, other));
        }

        fn gains(&self, _: u32) -> &[f32] {
            &[1.0]
        }
    }

    fn values(bundle: u32) -> [f32; N_VALUES] {
        let mut rng = Random::new([7, u64::from(bundle)]);
        std::array::from_fn(|_| rng.normal())
    }

    /// The mean of a value around a bundle, by the definition.
    fn mean(bundle: u32, value: usize, reach: u32, is_known: impl Fn(u32) -> bool) -> f32 {
        let [x, y] = [bundle % GRID[0], bundle / GRID[0]];
        let near = (0..GRID[0] * GRID[1])
            .filter(|other| (other % GRID[0]).abs_diff(x) <= reach && (other / GRID[0]).abs_diff(y) <= reach);
        let (mut sum, mut total) = (0.0, 0.0);
        for other in near.filter(|other| is_known(*other)) {
            let weight = Chance::of(bundle, other);
            if weight > LEAST_LIKENESS {
                sum += f64::from(weight) * f64::from(values(other)[value]);
                total += f64::from(weight);
            }
        }
        (sum / total) as f32
    }

    #[test]
    fn means_are_those_of_the_definition_at_every_edge_of_the_grid() {
        for tile in [5, 8, 16] {
            let partition = Partition { width: GRID[0], height: GRID[1], tile };
            for block_idx in 0..partition.n_blocks() {
                let mut own = Vec::new();
                partition.bundles(block_idx, &mut own);
                let is_known = |bundle: u32| !bundle.is_multiple_of(5) || own.contains(&bundle);
                let alike = Alike::new(&partition, block_idx, &Chance);
                let mut planes = Planes::new(&alike.window, N_VALUES);
                for line in alike.window.lines([0, 0, GRID[0], GRID[1]], GRID[0]) {
                    let bundles = || (line.bundle..).take(line.nth.len());
                    assert_eq!(line.bundle as usize, line.nth.start, "the grid as one tile");
                    planes.set_known(line.place, bundles().map(is_known));
                    let known = |bundle: u32| if is_known(bundle) { values(bundle) } else { [0.0; N_VALUES] };
                    let known: Vec<_> = bundles().map(known).collect();
                    planes.set(0, line.place, known.iter().map(|values| &values[..1]));
                    planes.set(1, line.place, known.iter().map(|values| &values[1..]));
                }
                let means = planes.means(&alike);
                for value in 0..N_VALUES {
                    let mut gram = [[1.0; N_MIXED]; N_MIXED];
                    means.add_products(value, &mut gram);
                    for (i, j) in (0..N_MIXED).flat_map(|i| (0..N_MIXED).map(move |j| (i, j))) {
                        let pairs = means.plane(i, value).iter().zip(means.plane(j, value));
                        let want = 1.0 + pairs.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum::<f64>();
                        assert!((gram[i][j] - want).abs() < 1e-9, "{tile}, {i}, {j}: {} {want}", gram[i][j]);
                    }
                }
                for (nth, reach) in [0].into_iter().chain(REACHES).enumerate() {
                    for value in 0..N_VALUES {
                        for (got, bundle) in means.plane(nth, value).iter().zip(&own) {
                            let want = mean(*bundle, value, reach, is_known);
                            assert!((got - want).abs() < 1e-5, "{tile}, bundle {bundle}, {reach}: {got} {want}");
                        }
                    }
                }
            }
        }
    }
}
