//! What packing promises of whole matrices.

use std::sync::Arc;

use super::*;
use crate::{factors::BlockError, matrix::SparseEntry, partition::Partition, random::Random};

const WIDTH: u32 = 40;
const HEIGHT: u32 = 24;

fn columns() -> Vec<ColumnRun> {
    vec![ColumnRun::List(3), ColumnRun::Grid { width: 8, height: 8 }]
}

/// Smooth waves over rows and columns, with some noise and some sparse entries; one block is missing.
fn example(noise: f32) -> BlockLowRank {
    let mut rng = Random::new([50, 0]);
    let partition = Partition { width: WIDTH, height: HEIGHT, tile: 16 };
    let mut matrix = BlockLowRank::new(partition.clone(), 3, 67);
    for block_idx in 0..partition.n_blocks() - 1 {
        let [x0, y0, w, h] = partition.rect(block_idx);
        let rank = 1 + block_idx % 4;
        let (m, n) = ((3 * w * h) as usize, 67);
        let wave = |at: f32, nth: usize| (at * (nth as f32 + 1.0) * 0.07).cos() / (nth as f32 + 1.0).powi(2);
        let mut left = vec![0.0; m * rank];
        for (at, x) in left.iter_mut().enumerate() {
            let (row, nth) = ((at / rank) as u32, at % rank);
            let bundle = row / 3;
            *x = wave((x0 + bundle % w + y0 + bundle / w + 5 * (row % 3)) as f32, nth) + noise * rng.normal();
        }
        let right: Vec<f32> = (0..rank * n).map(|at| wave((at % n) as f32, at / n) + noise * rng.normal()).collect();
        let mut factors = BlockFactors::from_f32(&left, &right, m, n, rank);
        factors.n_samples = 64;
        factors.error = BlockError { truncation: 1e-7, sampling: 1e-6, noise: 0.5 };
        factors.sparse = vec![SparseEntry { row: 1, col: 5, value: 12.0 }, SparseEntry { row: 4, col: 0, value: -0.1 }];
        matrix.blocks[block_idx] = Some(Arc::new(factors));
    }
    matrix
}

fn plan(allowed: f32) -> PackPlan {
    PackPlan { columns: columns(), allowed, strong: 0.0, apart: 0.0, preserved: vec![1.0; 67] }
}

/// Mean square difference over the blocks that are there.
fn difference(a: &BlockLowRank, b: &BlockLowRank) -> f64 {
    let both = a.blocks.iter().zip(&b.blocks).filter_map(|(a, b)| Some((a.as_ref()?, b.as_ref()?)));
    let (mut sum, mut n) = (0.0, 0);
    for (a, b) in both {
        sum += a.dense().iter().zip(b.dense()).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
        n += a.dense().len();
    }
    sum / n as f64
}

#[test]
fn a_packed_matrix_is_as_exact_as_asked_and_says_so() {
    for (noise, allowed) in [(0.0, 1e-3), (0.0, 1e-6), (0.05, 1e-3), (0.05, 1e-5)] {
        let matrix = example(noise);
        let packed = PackedMatrix::pack(&matrix, &plan(allowed));
        let unpacked = packed.unpack().unwrap();
        assert!(unpacked.blocks.iter().map(Option::is_some).eq(matrix.blocks.iter().map(Option::is_some)));
        // The sparse entries have errors of their own: a share of themselves.
        let bare = |matrix: &BlockLowRank| {
            let mut bare = matrix.clone();
            for block in bare.blocks.iter_mut().flatten() {
                *block = Arc::new(BlockFactors { sparse: Vec::new(), ..(**block).clone() });
            }
            bare
        };
        let error = difference(&bare(&matrix), &bare(&unpacked));
        let said = f64::from(unpacked.mean_error().truncation) - 1e-7;
        assert!(error <= 1.05 * f64::from(allowed), "{noise} {allowed}: {error}");
        assert!((said / error - 1.0).abs() < 0.02, "{noise} {allowed}: {said} for {error}");
        let [a, b] = [&matrix, &unpacked].map(|matrix| matrix.blocks[1].as_ref().unwrap().clone());
        assert_eq!((a.n_samples, a.error.noise, a.sparse.len()), (b.n_samples, b.error.noise, b.sparse.len()));
        assert!((b.sparse[0].value / a.sparse[0].value - 1.0).abs() < 2e-3);
        let most = packed.unpacked_bytes().unwrap();
        assert!((unpacked_bytes(&unpacked)..4 * unpacked_bytes(&unpacked)).contains(&most), "{most}");
    }
}

fn unpacked_bytes(matrix: &BlockLowRank) -> u64 {
    let of_block = |block: &Arc<BlockFactors>| u64::from(block.rank) * 2 * u64::from(block.n_rows + block.n_cols);
    matrix.blocks.iter().flatten().map(of_block).sum()
}

#[test]
fn smooth_factors_take_a_fraction_of_their_halves() {
    let matrix = example(0.0);
    let packed = PackedMatrix::pack(&matrix, &plan(1e-4));
    assert!(8 * packed.n_bytes() < matrix.n_bytes(), "{} of {}", packed.n_bytes(), matrix.n_bytes());
}

#[test]
fn the_preserved_product_is_kept_to_a_share_of_itself_whatever_is_allowed() {
    let mut matrix = example(0.05);
    for block in matrix.blocks.iter_mut().flatten() {
        let mut bare = BlockFactors { sparse: Vec::new(), ..(**block).clone() };
        bare.error.noise = 0.0;
        *block = Arc::new(bare);
    }
    // A block a thousand times weaker than the others, which rounds to nothing.
    let weak = Arc::make_mut(matrix.blocks[1].as_mut().unwrap());
    weak.scale.iter_mut().for_each(|scale| *scale /= 1024.0);
    let worst = |plan: &PackPlan| {
        let unpacked = PackedMatrix::pack(&matrix, plan).unpack().unwrap();
        let both = matrix.blocks.iter().flatten().zip(unpacked.blocks.iter().flatten());
        let relative = both.map(|(a, b)| {
            let (a, b) = (a.apply(&[1.0; 67]), b.apply(&[1.0; 67]));
            let squares = |x: &mut dyn Iterator<Item = f32>| x.map(|x| f64::from(x).powi(2)).sum::<f64>();
            (squares(&mut a.iter().zip(&b).map(|(a, b)| a - b)) / squares(&mut a.iter().copied())).sqrt()
        });
        relative.fold(0.0, f64::max)
    };
    for allowed in [1e-1, 1e-3, 1e-5] {
        let kept = worst(&plan(allowed));
        assert!(kept < 1e-3, "{allowed}: {kept}");
    }
    assert!(worst(&PackPlan { preserved: Vec::new(), ..plan(1e-3) }) > 0.1);
}

/// What packing takes from each entry of a block, squared.
fn squared_errors(matrix: &BlockLowRank, plan: &PackPlan, block_idx: usize) -> Vec<f64> {
    let unpacked = PackedMatrix::pack(matrix, plan).unpack().unwrap();
    let [a, b] = [matrix, &unpacked].map(|matrix| matrix.blocks[block_idx].as_ref().unwrap().dense());
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).collect()
}

#[test]
fn weak_blocks_are_stored_more_finely_where_it_is_told_which_are_strong() {
    let mut matrix = example(0.05);
    let weak = Arc::make_mut(matrix.blocks[1].as_mut().unwrap());
    weak.scale.iter_mut().for_each(|scale| *scale /= 16.0);
    weak.sparse.clear();
    let error = |strong: f32| {
        let plan = PackPlan { strong, preserved: Vec::new(), ..plan(1e-3) };
        squared_errors(&matrix, &plan, 1).iter().sum::<f64>()
    };
    // All blocks are weaker than 1: by the square root of their mean squares.
    let (plain, tightened) = (error(0.0), error(1.0));
    assert!(tightened < 0.3 * plain, "{tightened} {plain}");
}

#[test]
fn a_weak_column_is_stored_as_finely_as_it_is_weak_where_columns_are_apart() {
    let mut matrix = example(0.05);
    let block = Arc::make_mut(matrix.blocks[0].as_mut().unwrap());
    let (n_cols, weak) = (block.n_cols as usize, 7);
    block.right.iter_mut().skip(weak).step_by(n_cols).for_each(|x| *x = half::f16::from_f32(x.to_f32() / 32.0));
    block.sparse.clear();
    let error = |apart: f32| {
        let plan = PackPlan { apart, preserved: Vec::new(), ..plan(1e-3) };
        squared_errors(&matrix, &plan, 0).iter().skip(weak).step_by(n_cols).sum::<f64>()
    };
    let (together, apart) = (error(0.0), error(0.5));
    assert!(apart < 0.1 * together, "{apart} {together}");
}

#[test]
fn blocks_in_which_all_is_weak_are_stored_no_coarser_where_columns_are_apart() {
    let mut matrix = example(0.05);
    let block = Arc::make_mut(matrix.blocks[0].as_mut().unwrap());
    block.scale.iter_mut().for_each(|scale| *scale /= 65536.0);
    block.sparse.clear();
    let error = |apart: f32| {
        let plan = PackPlan { strong: 0.25, apart, preserved: Vec::new(), ..plan(1e-3) };
        squared_errors(&matrix, &plan, 0).iter().sum::<f64>()
    };
    let (together, apart) = (error(0.0), error(0.5));
    assert!(apart <= 1.1 * together, "{apart} {together}");
}

/// The noise of one column says nothing of the others.
#[test]
fn a_noisy_block_is_stored_at_worst_as_a_block_without_noise() {
    let mut matrix = example(0.0);
    let error = BlockError { truncation: 0.0, sampling: 1e3, noise: 1e3 };
    let noisy = BlockFactors { error, ..matrix.blocks[0].as_deref().unwrap().clone() };
    matrix.blocks[0] = Some(Arc::new(noisy));
    let allowed = 1e-4;
    let restored = PackedMatrix::pack(&matrix, &plan(allowed)).unpack().unwrap();
    let [before, after] = [&matrix, &restored].map(|matrix| matrix.blocks[0].as_deref().unwrap().dense());
    let added = before.iter().zip(&after).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / before.len() as f64;
    assert!(added <= 1.05 * WORST_BLOCK * f64::from(allowed), "{added:e} where {allowed:e} is allowed");
}

#[test]
fn what_no_factor_can_hold_is_not_looked_for() {
    // Less than what is lost by factors of 16 bits, of noisy blocks, too, which may be as fine as it takes.
    for own in [0.0, 1e-2] {
        let mut matrix = example(0.0);
        for block in matrix.blocks.iter_mut().flatten() {
            let error = BlockError { truncation: own, sampling: own, noise: 0.5 };
            *block = Arc::new(BlockFactors { error, sparse: Vec::new(), ..(**block).clone() });
        }
        let of = |allowed: f32| PackedMatrix::pack(&matrix, &plan(allowed));
        let held = of(1e-8);
        for allowed in [1e-14, 1e-20, 0.0] {
            let beyond = of(allowed);
            let error = difference(&matrix, &beyond.unpack().unwrap());
            assert!(error < 1e-6, "{own} {allowed}: {error}");
            let (n_beyond, n_held) = (beyond.n_bytes(), held.n_bytes());
            assert!(n_beyond < 5 * n_held, "{own} {allowed}: {n_beyond} against {n_held} bytes");
        }
    }
}

/// Blocks in a row, so many that a part of them tells of the others: a wave times a number of each, or nothing.
fn long_strip(size: impl Fn(usize) -> f32) -> BlockLowRank {
    let partition = Partition { width: 2 * LONG as u32, height: 2, tile: 2 };
    let mut matrix = BlockLowRank::new(partition, 3, 67);
    let mut rng = Random::new([53, 0]);
    let mut wave = |len: usize| (0..len).map(|at| (0.3 * at as f32).cos() + 0.2 * rng.normal()).collect::<Vec<f32>>();
    for block_idx in 0..LONG {
        let (left, right, size) = (wave(12), wave(67), size(block_idx));
        let left: Vec<f32> = left.iter().map(|x| x * size).collect();
        let factors = match size {
            0.0 => BlockFactors::from_f32(&[], &[], 12, 67, 0),
            _ => BlockFactors::from_f32(&left, &right, 12, 67, 1),
        };
        matrix.blocks[block_idx] = Some(Arc::new(factors));
    }
    matrix
}

const LONG: usize = 2200;

#[test]
fn blocks_between_thousands_of_empty_or_weak_ones_are_stored_as_exactly_as_asked() {
    let allowed = 1e-3;
    let lone = |block_idx: usize| if block_idx == 1234 { 1.0 } else { 0.0 };
    let third = |block_idx: usize| if block_idx % 3 == 1 { 1.0 } else { 0.0 };
    let half = |block_idx: usize| if block_idx % 40 < 20 { 1.0 } else { 0.0 };
    let weak_third = |block_idx: usize| if block_idx.is_multiple_of(3) { 1e-3 } else { 1.0 };
    let strips: [(&str, &dyn Fn(usize) -> f32); 4] =
        [("lone", &lone), ("third", &third), ("half", &half), ("weak third", &weak_third)];
    for (name, size) in strips {
        let matrix = long_strip(size);
        let plan = PackPlan { preserved: Vec::new(), ..plan(allowed) };
        let unpacked = PackedMatrix::pack(&matrix, &plan).unpack().unwrap();
        let mean = difference(&matrix, &unpacked);
        assert!(mean <= 1.05 * f64::from(allowed), "{name}: {mean:e} where {allowed:e} is allowed");
        for (block_idx, both) in matrix.blocks.iter().zip(&unpacked.blocks).enumerate() {
            let (before, after) = (both.0.as_ref().unwrap().dense(), both.1.as_ref().unwrap().dense());
            let squares = before.iter().zip(&after).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            let error = squares / before.len() as f64;
            assert!(error <= 1.05 * WORST_BLOCK * f64::from(allowed), "{name}, block {block_idx}: {error:e}");
        }
    }
}

/// A rank that holds nothing has no coefficients: blocks of that kind tell of no step.
#[test]
fn a_lone_block_among_thousands_whose_components_are_zero_keeps_its_own() {
    let mut matrix = long_strip(|_| 1.0);
    for (block_idx, block) in matrix.blocks.iter_mut().flatten().enumerate() {
        if block_idx != 1234 {
            Arc::make_mut(block).scale.fill(0.0);
        }
    }
    let allowed = 1e-3;
    let plan = PackPlan { preserved: Vec::new(), ..plan(allowed) };
    let unpacked = PackedMatrix::pack(&matrix, &plan).unpack().unwrap();
    let error = difference(&matrix, &unpacked) * LONG as f64;
    assert!(error <= 1.05 * WORST_BLOCK * f64::from(allowed), "{error:e}");
}

#[test]
fn errors_beyond_every_number_are_told_as_the_greatest() {
    let mut matrix = example(0.0);
    let factors = Arc::make_mut(matrix.blocks[0].as_mut().unwrap());
    factors.error = BlockError { truncation: f32::NAN, sampling: f32::MAX, noise: f32::MIN };
    let unpacked = PackedMatrix::pack(&matrix, &plan(1e-3)).unpack().unwrap();
    let told = unpacked.blocks[0].as_ref().unwrap().error;
    assert!(told.truncation > 3.3e38 && told.truncation.is_finite(), "{told:?}");
    assert!(told.sampling > 3.3e38 && told.sampling.is_finite(), "{told:?}");
    assert!(told.noise < -3.3e38 && told.noise.is_finite(), "{told:?}");
}

#[test]
fn bytes_come_back_and_every_single_changed_one_is_noticed() {
    let packed = PackedMatrix::pack(&example(0.0), &plan(1e-3));
    let mut bytes = Vec::new();
    packed.encode(&mut bytes);
    let read = |bytes: &[u8]| PackedMatrix::decode(bytes, packed.layout.partition.clone(), 3, columns());
    let (again, len) = read(&bytes).unwrap();
    assert_eq!(len, bytes.len());
    assert_eq!(again.unpack().unwrap().blocks, packed.unpack().unwrap().blocks);
    for i in 0..bytes.len() {
        let mut changed = bytes.clone();
        changed[i] ^= 1 << (i % 8);
        assert!(read(&changed).is_err(), "byte {i}");
        assert!(i % 7 != 0 || read(&bytes[..i]).is_err(), "cut off at {i}");
    }
}

/// The same with bundles of zeros on one side of a slope that crosses most blocks, and beyond a column that crosses the others.
fn half_empty(mut matrix: BlockLowRank) -> BlockLowRank {
    for block_idx in 0..matrix.blocks.len() {
        let n_values =
            matrix.bundle_len as usize * matrix.blocks[block_idx].as_ref().map_or(0, |block| block.rank as usize);
        let mut bundles = Vec::new();
        matrix.partition.bundles(block_idx, &mut bundles);
        let Some(block) = &mut matrix.blocks[block_idx] else { continue };
        let block = Arc::make_mut(block);
        block.sparse.clear();
        for (&bundle, values) in bundles.iter().zip(block.left.chunks_exact_mut(n_values)) {
            if is_empty(bundle) {
                values.fill(half::f16::ZERO);
            }
        }
    }
    matrix
}

/// Whether [`half_empty`] has zeros there.
fn is_empty(bundle: u32) -> bool {
    let (x, y) = (bundle % WIDTH, bundle / WIDTH);
    x + 2 * y < 27 || x > 36
}

#[test]
fn what_is_zero_stays_zero_however_coarse_the_step() {
    let mut matrix = half_empty(example(0.05));
    // A block that holds nothing but the kept direction.
    Arc::make_mut(matrix.blocks[1].as_mut().unwrap()).scale.iter_mut().for_each(|scale| *scale /= 1024.0);
    let mut rng = Random::new([54, 0]);
    let x: Vec<f32> = (0..67).map(|_| rng.normal()).collect();
    for (allowed, preserved) in [(1e-2, false), (1e-1, true), (1e-3, false), (1e-3, true), (1e-6, true)] {
        let preserved = if preserved { vec![1.0; 67] } else { Vec::new() };
        let packed = PackedMatrix::pack(&matrix, &PackPlan { preserved, ..plan(allowed) });
        assert!(packed.tells_zeros());
        let mut bytes = Vec::new();
        packed.encode(&mut bytes);
        let (packed, _) = PackedMatrix::decode(&bytes, packed.layout.partition.clone(), 3, columns()).unwrap();
        assert!(packed.tells_zeros());
        let unpacked = packed.unpack().unwrap();
        for rows in [unpacked.apply(&x), packed.product().unwrap().apply(&x)] {
            let is_nonzero = |bundle: &u32| rows[3 * *bundle as usize..][..3].iter().any(|x| *x != 0.0);
            let nonzero: Vec<u32> = (0..WIDTH * HEIGHT).filter(is_nonzero).collect();
            assert!(nonzero.len() > 200, "{allowed}: {} bundles", nonzero.len());
            assert!(!nonzero.iter().any(|bundle| is_empty(*bundle)), "{allowed}: something where nothing is");
        }
        let (error, said) = (difference(&matrix, &unpacked), f64::from(unpacked.mean_error().truncation) - 1e-7);
        assert!(error <= 1.05 * WORST_BLOCK * f64::from(allowed), "{allowed}: {error}");
        assert!((said / error - 1.0).abs() < 0.02, "{allowed}: {said} for {error}");
    }
}

#[test]
fn a_matrix_without_zeros_is_stored_as_ever() {
    let packed = PackedMatrix::pack(&example(0.05), &plan(1e-3));
    assert!(!packed.tells_zeros());
    let mut bytes = Vec::new();
    packed.encode(&mut bytes);
    assert!(f32::from_le_bytes(*bytes.first_chunk().unwrap()) > 0.0);
}

#[test]
fn blocks_of_nobody_are_errors_and_never_panics() {
    for matrix in [example(0.02), half_empty(example(0.02))] {
        forged_blocks_are_errors(PackedMatrix::pack(&matrix, &plan(1e-3)));
    }
}

fn forged_blocks_are_errors(mut packed: PackedMatrix) {
    let mut rng = Random::new([51, 0]);
    let mut n_errors = 0;
    for _ in 0..3000 {
        let block_idx = rng.below(packed.blocks.len() - 1);
        let honest = packed.blocks[block_idx].clone();
        let mut forged = honest.to_vec();
        for _ in 0..1 + rng.below(4) {
            let at = rng.below(forged.len());
            forged[at] = rng.bits() as u8;
        }
        forged.truncate(1 + rng.below(2 * forged.len()));
        packed.blocks[block_idx] = forged.into();
        let _ = packed.unpacked_bytes();
        n_errors += usize::from(packed.unpack().is_err());
        packed.blocks[block_idx] = honest;
    }
    assert!(n_errors > 2900, "{n_errors}");
}

#[test]
fn nothing_and_next_to_nothing_pack() {
    let partition = Partition { width: 3, height: 1, tile: 2 };
    let mut matrix = BlockLowRank::new(partition, 1, 1);
    let plan =
        PackPlan { columns: vec![ColumnRun::List(1)], allowed: 1e-3, strong: 0.0, apart: 0.0, preserved: Vec::new() };
    let there_and_back = |matrix: &BlockLowRank| PackedMatrix::pack(matrix, &plan).unpack().unwrap();
    assert!(there_and_back(&matrix).blocks.iter().all(Option::is_none));
    let zero = BlockFactors::from_f32(&[], &[], 2, 1, 0);
    matrix.blocks[0] = Some(Arc::new(zero.clone()));
    matrix.blocks[1] = Some(Arc::new(BlockFactors::from_f32(&[4.0], &[0.5], 1, 1, 1)));
    let back = there_and_back(&matrix);
    assert_eq!(*back.blocks[0].clone().unwrap(), zero);
    assert!((back.blocks[1].as_ref().unwrap().entry(0, 0) - 2.0).abs() < 0.05);
}

#[test]
fn the_same_matrix_gives_the_same_bytes_on_any_number_of_threads() {
    let bytes = |n_threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
        let mut bytes = Vec::new();
        pool.install(|| PackedMatrix::pack(&example(0.05), &plan(1e-4))).encode(&mut bytes);
        bytes
    };
    assert_eq!(bytes(1), bytes(3));
}

#[test]
fn products_in_cosines_are_those_of_the_factors() {
    let mut matrix = example(0.02);
    // A block that holds nothing but the kept direction, and one that holds nothing but sparse entries.
    let weak = Arc::make_mut(matrix.blocks[1].as_mut().unwrap());
    weak.scale.iter_mut().for_each(|scale| *scale /= 1024.0);
    Arc::make_mut(matrix.blocks[2].as_mut().unwrap()).scale.fill(0.0);
    let packed = PackedMatrix::pack(&matrix, &plan(1e-3));
    let (product, unpacked) = (packed.product().unwrap(), packed.unpack().unwrap());
    assert!(unpacked.blocks[2].as_ref().unwrap().rank == 0);
    let mut rng = Random::new([52, 0]);
    let x: Vec<f32> = (0..67).map(|_| rng.normal()).collect();
    let (got, want) = (product.apply(&x), unpacked.apply(&x));
    let size = want.iter().map(|x| x * x).sum::<f32>().sqrt() / (want.len() as f32).sqrt();
    assert!(got.len() == want.len());
    assert!(got.iter().zip(&want).all(|(got, want)| (got - want).abs() < 4e-3 * size.max(want.abs())));
    // Smooth columns are few coefficients.
    let [right, left] = product.n_multiplications();
    let ranks: usize = unpacked.blocks.iter().flatten().map(|block| block.rank as usize).sum();
    assert!(2 * right < 67 * ranks && left > 0, "{right} for {ranks} components");
}
