//! Weighted means over what lies around each bundle of a tile: sums along rows of the grid, so that vectors run over bundles.
#![cfg_attr(
    target_arch = "x86_64",
    expect(
        unsafe_code,
        reason = "a call of what is compiled for AVX2, behind run-time detection; the same safe code without"
    )
)]

use crate::partition::Partition;

use super::{LEAST_LIKENESS, Likeness, N_MIXED, REACHES};

/// Bundles that are summed for side by side.
const LANES: usize = 8;
/// Planes that are summed at a time.
const PLANES: usize = 4;
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

    /// Where a bundle of the grid lies, if it is within reach.
    pub(super) fn place(&self, x: u32, y: u32) -> Option<usize> {
        let [left, top, ..] = self.tile;
        let (column, row) = ((x as usize + REACH).wrapping_sub(left), (y as usize + REACH).wrapping_sub(top));
        (column < self.stride && row < self.n_rows).then(|| row * self.stride + column)
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
    /// Planes × places of the window. The last of those that are used is 1 where a bundle is known; unknown ones are 0 in all.
    data: Vec<f32>,
    n_values: usize,
    n_places: usize,
}

impl Planes {
    /// Nothing is known yet.
    pub(super) fn new(window: &Window, n_values: usize) -> Self {
        let n_places = window.stride * window.n_rows;
        let data = vec![0.0; (n_values + 1).next_multiple_of(PLANES) * n_places];
        Planes { data, n_values, n_places }
    }

    /// Tells all values of a bundle.
    pub(super) fn set(&mut self, place: usize, values: &[f32]) {
        let planes = self.data[place..].iter_mut().step_by(self.n_places);
        planes.zip(values.iter().chain(&[1.0])).for_each(|(plane, value)| *plane = *value);
    }

    /// The values of the bundles of a tile as they are, and their three means.
    pub(super) fn means(&self, alike: &Alike) -> Means {
        let (window, n_values) = (&alike.window, self.n_values);
        let ([_, _, width, _], n_bundles, n_lanes) = (window.tile, window.n_bundles(), window.n_lanes());
        let mut means = Means { data: vec![0.0; N_MIXED * n_values * n_bundles], n_values, n_bundles };
        let mut sums = vec![Lanes::default(); (n_values + 1).next_multiple_of(PLANES)];
        for (y, row) in alike.rows.iter().enumerate() {
            for lane in 0..n_lanes {
                let first = y * window.stride + lane * LANES;
                let bundles = y * width + lane * LANES..(y + 1) * width;
                let mut within = 0..0;
                sums.fill(Lanes::default());
                for (mean, end) in row.n_within.into_iter().enumerate() {
                    within = within.end..end;
                    let around = Around {
                        places: &row.places[within.clone()],
                        weights: &row.weights[within.start * n_lanes..end * n_lanes],
                        n_lanes,
                        lane,
                    };
                    let planes = self.data.chunks_exact(PLANES * self.n_places);
                    for (planes, sums) in planes.zip(sums.as_chunks_mut().0) {
                        let plane = |nth: usize| &planes[nth * self.n_places..][..self.n_places][first..];
                        around.add([plane(0), plane(1), plane(2), plane(3)], sums);
                    }
                    let total = sums[n_values];
                    for (value, sums) in sums[..n_values].iter().enumerate() {
                        let out = &mut means.plane_mut(mean, value)[bundles.clone()];
                        // Around what nothing is known of, sums and totals are 0.
                        let divided = |(sum, total): (&f32, &f32)| sum / total.max(f32::MIN_POSITIVE);
                        out.iter_mut().zip(sums.iter().zip(&total).map(divided)).for_each(|(out, mean)| *out = mean);
                    }
                }
            }
        }
        means
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
    fn add(&self, planes: [&[f32]; PLANES], sums: &mut [Lanes; PLANES]) {
        #[cfg(target_arch = "x86_64")]
        if is_x86_feature_detected!("avx2") {
            // SAFETY: AVX2 was found.
            return unsafe { self.add_avx2(planes, sums) };
        }
        self.add_plain(planes, sums);
    }

    /// The same numbers, eight at a time.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn add_avx2(&self, planes: [&[f32]; PLANES], sums: &mut [Lanes; PLANES]) {
        self.add_plain(planes, sums);
    }

    #[inline(always)]
    fn add_plain(&self, planes: [&[f32]; PLANES], sums: &mut [Lanes; PLANES]) {
        // A copy, and loops instead of closures: sums whose address is taken would live in memory.
        let mut own = *sums;
        for (place, weights) in self.places.iter().zip(self.weights.chunks_exact(self.n_lanes)) {
            let weights = &weights[self.lane];
            for (plane, sums) in planes.iter().zip(&mut own) {
                let values: &Lanes = plane[*place..].first_chunk().expect("a window reaches as far as its places");
                for lane in 0..LANES {
                    sums[lane] += weights[lane] * values[lane];
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
                for bundle in (0..GRID[0] * GRID[1]).filter(|bundle| is_known(*bundle)) {
                    if let Some(place) = alike.window.place(bundle % GRID[0], bundle / GRID[0]) {
                        planes.set(place, &values(bundle));
                    }
                }
                let means = planes.means(&alike);
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
