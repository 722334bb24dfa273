//! Weighted k-means with k-means++ seeds \[Arthur2007\]; what is asked for are members, not means.
#![cfg_attr(
    target_arch = "x86_64",
    expect(unsafe_code, reason = "AVX2 behind run-time detection; `plain` is the safe twin with the same results")
)]

use crate::{
    dense::{Dense, add_scaled},
    random::Random,
    rivals::Real,
};

/// Rounds of Lloyd's iteration: representatives hardly move after these.
const N_ROUNDS: usize = 4;

/// At most `count` different points (rows of `points`), one near the middle of each cluster, in the order of their seeds.
/// Points of weight 0 are never chosen; duplicates count as one point.
pub(crate) fn representatives<T: Real>(
    points: &Dense<T>,
    weights: &[f32],
    count: usize,
    rng: &mut Random,
) -> Vec<usize> {
    #[cfg(target_arch = "x86_64")]
    if is_x86_feature_detected!("avx2") {
        // SAFETY: AVX2 was found.
        return unsafe { avx2(points, weights, count, rng) };
    }
    plain(points, weights, count, rng)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn avx2<T: Real>(points: &Dense<T>, weights: &[f32], count: usize, rng: &mut Random) -> Vec<usize> {
    clustered(points, weights, count, rng)
}

fn plain<T: Real>(points: &Dense<T>, weights: &[f32], count: usize, rng: &mut Random) -> Vec<usize> {
    clustered(points, weights, count, rng)
}

#[inline(always)]
fn clustered<T: Real>(points: &Dense<T>, weights: &[f32], count: usize, rng: &mut Random) -> Vec<usize> {
    let mut centers = seeds(points, weights, count, rng);
    if centers.n_rows == 0 {
        return Vec::new();
    }
    let mut cluster = vec![0; points.n_rows];
    for _ in 0..N_ROUNDS {
        for (i, cluster) in cluster.iter_mut().enumerate() {
            *cluster = nearest(points.row(i), &centers);
        }
        move_to_means(points, weights, &cluster, &mut centers);
    }
    let mut chosen: Vec<Option<(T, usize)>> = vec![None; centers.n_rows];
    for i in (0..points.n_rows).filter(|&i| weights[i] > 0.0) {
        let best = &mut chosen[cluster[i]];
        let distance = distance_squared(points.row(i), centers.row(cluster[i]));
        if best.is_none_or(|(least, _)| distance < least) {
            *best = Some((distance, i));
        }
    }
    chosen.into_iter().flatten().map(|(_, i)| i).collect()
}

/// k-means++: each further seed with a probability that grows with its squared distance from the seeds before it.
#[inline(always)]
fn seeds<T: Real>(points: &Dense<T>, weights: &[f32], count: usize, rng: &mut Random) -> Dense<T> {
    let mut centers = Dense::zeros(0, points.n_cols);
    let mut chances: Vec<f64> = weights.iter().map(|&w| f64::from(w)).collect();
    let mut least = vec![T::nearest(f64::INFINITY); points.n_rows];
    while centers.n_rows < count {
        let Some(pick) = pick(&chances, rng) else { break };
        centers.data.extend_from_slice(points.row(pick));
        centers.n_rows += 1;
        for i in 0..points.n_rows {
            least[i] = least[i].min(distance_squared(points.row(i), points.row(pick)));
            chances[i] = f64::from(weights[i]) * least[i].to_f64();
        }
    }
    centers
}

/// One index, with a probability in proportion to its chance; none if all are zero.
fn pick(chances: &[f64], rng: &mut Random) -> Option<usize> {
    let mut left = rng.unit() * chances.iter().sum::<f64>();
    let mut last = None;
    for (i, &chance) in chances.iter().enumerate().filter(|(_, chance)| **chance > 0.0) {
        last = Some(i);
        left -= chance;
        if left < 0.0 {
            break;
        }
    }
    last
}

/// A cluster without weight keeps its center.
#[inline(always)]
fn move_to_means<T: Real>(points: &Dense<T>, weights: &[f32], cluster: &[usize], centers: &mut Dense<T>) {
    let mut sums = Dense::zeros(centers.n_rows, centers.n_cols);
    let mut totals = vec![T::zero(); centers.n_rows];
    for (i, &cluster) in cluster.iter().enumerate() {
        let weight = T::nearest(f64::from(weights[i]));
        add_scaled(sums.row_mut(cluster), weight, points.row(i));
        totals[cluster] += weight;
    }
    for (k, &total) in totals.iter().enumerate().filter(|(_, total)| **total > T::zero()) {
        centers.row_mut(k).iter_mut().zip(sums.row(k)).for_each(|(center, &sum)| *center = sum / total);
    }
}

#[inline(always)]
fn nearest<T: Real>(point: &[T], centers: &Dense<T>) -> usize {
    let mut best = (T::nearest(f64::INFINITY), 0);
    for k in 0..centers.n_rows {
        let distance = distance_squared(point, centers.row(k));
        if distance < best.0 {
            best = (distance, k);
        }
    }
    best.1
}

#[inline(always)]
fn distance_squared<T: Real>(a: &[T], b: &[T]) -> T {
    let mut sums = [T::zero(); 8];
    let (a8, b8) = (a.chunks_exact(8), b.chunks_exact(8));
    let rest = a8.remainder().iter().zip(b8.remainder()).map(|(&x, &y)| (x - y) * (x - y));
    let rest = rest.fold(T::zero(), |sum, x| sum + x);
    for (x, y) in a8.zip(b8) {
        for lane in 0..8 {
            sums[lane] += (x[lane] - y[lane]) * (x[lane] - y[lane]);
        }
    }
    rest + sums.iter().fold(T::zero(), |sum, &x| sum + x)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_clouds_give_one_member_each() {
        let mut rng = Random::new([5, 0]);
        let data = (0..90).flat_map(|i| [(i % 3) as f32 * 10.0 + 0.1 * rng.normal(), 0.1 * rng.normal()]).collect();
        let points = Dense { n_rows: 90, n_cols: 2, data };
        let mut clouds: Vec<usize> =
            representatives(&points, &[1.0; 90], 3, &mut rng).into_iter().map(|i| i % 3).collect();
        clouds.sort_unstable();
        assert_eq!(clouds, [0, 1, 2]);
    }

    #[test]
    fn duplicates_count_once_and_weightless_points_never() {
        let mut rng = Random::new([6, 0]);
        let points = Dense { n_rows: 6, n_cols: 1, data: vec![1.0, 1.0, 2.0, 2.0, 9.0, 0.0] };
        let mut chosen = representatives(&points, &[1.0, 1.0, 1.0, 1.0, 0.0, 0.0], 5, &mut rng);
        chosen.sort_unstable();
        assert_eq!(chosen, [0, 2]);
        assert!(representatives(&points, &[0.0; 6], 5, &mut rng).is_empty());
    }

    #[test]
    fn the_key_alone_decides() {
        let mut rng = Random::new([7, 0]);
        let points = Dense { n_rows: 200, n_cols: 11, data: (0..2200).map(|_| rng.normal()).collect() };
        let chosen = |key| {
            let chosen = representatives(&points, &[1.0; 200], 12, &mut Random::new([key, 1]));
            assert_eq!(chosen, plain(&points, &[1.0; 200], 12, &mut Random::new([key, 1])));
            chosen
        };
        assert_eq!(chosen(1), chosen(1));
        assert_ne!(chosen(1), chosen(2));
    }

    #[test]
    fn a_seed_is_chosen_by_its_squared_distance_from_those_before() {
        // The first is practically always the heavy one; then 1 against 4, and never the heavy one again.
        let points = Dense { n_rows: 3, n_cols: 1, data: vec![0.0f32, 1.0, 2.0] };
        let n_keys = 4000;
        let n_far = (0..n_keys).filter(|&key| {
            let seeds = seeds(&points, &[1e9, 1.0, 1.0], 2, &mut Random::new([key, 2]));
            assert_eq!(seeds.data[0], 0.0);
            seeds.data[1] == 2.0
        });
        let (mean, sd) = (0.8 * n_keys as f64, (0.16 * n_keys as f64).sqrt());
        let z = (n_far.count() as f64 - mean) / sd;
        assert!(z.abs() < 4.0, "{z} standard deviations from four in five");
    }
}
