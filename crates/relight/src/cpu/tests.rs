use super::*;
use crate::synthetic::{Ranks, Recipe};
use std::sync::Arc;

fn relit(relighter: &mut CpuRelighter, x: &[Vec<[f32; 3]>]) -> Vec<[f32; 3]> {
    let mut out = Radiance::default();
    relighter.relight(x, &mut out).unwrap();
    out.pixels
}

pub(super) fn assert_near(a: &[[f32; 3]], b: &[[f32; 3]], tolerance: f32) {
    let largest = b.as_flattened().iter().fold(0f32, |m, v| m.max(v.abs()));
    for (i, (a, b)) in a.as_flattened().iter().zip(b.as_flattened()).enumerate() {
        assert!((a - b).abs() <= tolerance * largest, "entry {i}: {a} against {b}, largest {largest}");
    }
}

/// The definition, entry by entry of the dense matrix, in f64.
pub(super) fn dense(frame: &Frame, x: &[Vec<[f32; 3]>]) -> Vec<[f32; 3]> {
    let mut out = vec![[0f64; 3]; frame.width as usize * frame.height as usize];
    let mut bundles = Vec::new();
    for (low_rank, x) in frame.groups.iter().zip(x) {
        for (block_idx, block) in low_rank.blocks.iter().enumerate() {
            let Some(f) = block else { continue };
            low_rank.partition.bundles(block_idx, &mut bundles);
            for row in 0..f.n_rows as usize {
                let (pixel, channel) = (bundles[row / 3] as usize, row % 3);
                for (col, rgb) in x.iter().enumerate() {
                    let mut entry = 0f64;
                    for k in 0..f.rank as usize {
                        let right = f.right[k * f.n_cols as usize + col].to_f64();
                        entry += f.left[row * f.rank as usize + k].to_f64() * f64::from(f.scale[k]) * right;
                    }
                    let mine = f.sparse.iter().filter(|s| s.row as usize == row && s.col as usize == col);
                    entry += mine.map(|s| f64::from(s.value)).sum::<f64>();
                    out[pixel][channel] += entry * f64::from(rgb[channel]);
                }
            }
        }
    }
    out.iter().map(|p| p.map(|v| v as f32)).collect()
}

#[test]
fn all_kernels_equal_the_dense_matrix() {
    let low = Recipe { tile: 16, rank: Ranks::Fixed(1), seed: 4, ..Recipe::default() };
    for recipe in [low, Recipe::default(), Recipe { tile: 5, n_cols: vec![3, 8, 33], seed: 2, ..Recipe::default() }] {
        let (frame, x) = (recipe.frame(), recipe.coefficients(3));
        let expected = dense(&frame, &x);
        for kernel in Kernel::all() {
            let mut relighter = CpuRelighter::with_kernel(&frame, kernel, Precision::Halves).unwrap();
            assert_near(&relit(&mut relighter, &x), &expected, 2e-6);
        }
    }
}

#[test]
fn light_of_two_sums_equals_the_sum_of_two_lights() {
    let recipe = Recipe::default();
    let mut relighter = CpuRelighter::new(&recipe.frame()).unwrap();
    let (a, b) = (recipe.coefficients(1), recipe.coefficients(2));
    let add3 = |a: &[f32; 3], b: &[f32; 3]| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
    let add_all = |a: &[[f32; 3]], b: &[[f32; 3]]| a.iter().zip(b).map(|(a, b)| add3(a, b)).collect::<Vec<_>>();
    let both: Vec<_> = a.iter().zip(&b).map(|(a, b)| add_all(a, b)).collect();
    let apart = add_all(&relit(&mut relighter, &a), &relit(&mut relighter, &b));
    assert_near(&relit(&mut relighter, &both), &apart, 2e-6);
}

#[test]
fn the_answer_does_not_depend_on_what_was_asked_before() {
    let recipe = Recipe { n_cols: vec![19, 1, 40], ..Recipe::default() };
    let frame = recipe.frame();
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    for step in 0..8 {
        let mut x = recipe.coefficients(step / 2);
        x[step as usize % 3].fill([0.0; 3]);
        x[2][5] = [step as f32; 3];
        let fresh = relit(&mut CpuRelighter::new(&frame).unwrap(), &x);
        assert_eq!(relit(&mut relighter, &x), fresh, "step {step}");
    }
}

#[test]
fn only_groups_that_changed_are_expanded() {
    let recipe = Recipe { n_cols: vec![19, 1, 40], rank: Ranks::Fixed(5), n_sparse: 0, ..Recipe::default() };
    let frame = recipe.frame();
    let n_blocks = frame.partition().n_blocks();
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut x = recipe.coefficients(1);

    relit(&mut relighter, &x);
    assert_eq!((relighter.stats().n_expanded, relighter.stats().n_skipped), (3 * n_blocks, 0));
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats(), RelightStats { n_skipped: 3 * n_blocks, ..Default::default() });

    x[1][0] = [2.0; 3];
    relit(&mut relighter, &x);
    assert_eq!((relighter.stats().n_expanded, relighter.stats().n_skipped), (n_blocks, 2 * n_blocks));

    let lit = std::mem::replace(&mut x[2], vec![[0.0; 3]; 40]);
    relit(&mut relighter, &x);
    assert_eq!((relighter.stats().n_dark_groups, relighter.stats().n_bytes), (1, 0));
    x[2] = lit;
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_expanded, 0, "a group switched on again is still cached");
}

#[test]
fn a_block_that_does_not_see_the_changed_column_is_not_expanded() {
    let recipe = Recipe { n_cols: vec![16], rank: Ranks::Fixed(4), n_sparse: 0, ..Recipe::default() };
    let mut frame = recipe.frame();
    let block = Arc::make_mut(frame.groups[0].blocks[1].as_mut().unwrap());
    (0..4).for_each(|k| block.right[k * 16 + 3] = half::f16::ZERO);
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut x = recipe.coefficients(1);
    relit(&mut relighter, &x);
    x[0][3] = [9.0; 3];
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_skipped, 1);
}

#[test]
fn one_light_of_many_reads_its_own_segment_of_columns() {
    let recipe = Recipe { n_cols: vec![1000], rank: Ranks::Fixed(5), n_sparse: 0, ..Recipe::default() };
    let frame = recipe.frame();
    let n_blocks = frame.partition().n_blocks() as u64;
    let left_bytes: u64 = frame.groups[0].blocks.iter().flatten().map(|b| 2 * b.left.len() as u64).sum();
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut x = recipe.coefficients(1);
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_bytes, left_bytes + n_blocks * 5 * 1000 * 2);
    x[0][700] = [3.0; 3];
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_bytes, left_bytes + n_blocks * 5 * 128 * 2);
}

#[test]
fn ten_thousand_increments_end_exactly_where_a_fresh_relight_does() {
    let recipe = Recipe { width: 20, height: 9, n_cols: vec![150, 9], rank: Ranks::Mixed(6), ..Recipe::default() };
    let frame = recipe.frame();
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut x = recipe.coefficients(1);
    let mut last = Vec::new();
    for step in 0..10_000usize {
        let (group, col) = if step % 5 == 0 { (1, step % 9) } else { (0, step * 7 % 150) };
        x[group][col] = [0.01 * (step % 331) as f32, 0.3, 0.02 * (step % 57) as f32];
        last = relit(&mut relighter, &x);
    }
    assert_eq!(last, relit(&mut CpuRelighter::new(&frame).unwrap(), &x));
}

#[test]
fn sums_that_are_not_kept_while_all_changes_change_no_bit_and_come_back_when_little_does() {
    let recipe = Recipe { n_cols: vec![300, 9], rank: Ranks::Mixed(6), n_sparse: 2, ..Recipe::default() };
    let frame = recipe.frame();
    let display = crate::DisplayParams { exposure_ev: -9.0, ..crate::DisplayParams::default() };
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut out = Radiance::default();
    let fresh = |x: &[Vec<[f32; 3]>]| relit(&mut CpuRelighter::new(&frame).unwrap(), x);
    let mut x = recipe.coefficients(0);
    let whole = |relighter: &mut CpuRelighter, x: &[Vec<[f32; 3]>]| {
        assert_eq!(relit(relighter, x), fresh(x));
        relighter.stats().n_bytes
    };
    for step in 1..9 {
        x = recipe.coefficients(step);
        whole(&mut relighter, &x);
    }
    x[0][3] = [3.0; 3];
    let again = whole(&mut relighter, &x);
    x[0][4] = [2.0; 3];
    let kept = whole(&mut relighter, &x);
    assert!(kept < again, "{kept} bytes once sums are kept, {again} before");
    // The same where little that moves is not seen: it comes to light later, from sums that nobody kept.
    for step in 0..3 {
        x = recipe.coefficients(20);
        x.iter_mut().flatten().for_each(|rgb| rgb[1] += 1e-6 * step as f32);
        relighter.relight_for_display(&x, &display, &mut out).unwrap();
    }
    assert!(relighter.stats().n_unseen > 0);
    assert_eq!(relit(&mut relighter, &x), fresh(&x));
    let other = Recipe { seed: 9, ..recipe.clone() }.frame();
    let mut changed = frame.clone();
    changed.groups[0].blocks[2] = other.groups[0].blocks[2].clone();
    relighter.update(&changed, &[(0, 2)]).unwrap();
    assert_eq!(relit(&mut relighter, &x), relit(&mut CpuRelighter::new(&changed).unwrap(), &x));
}

#[test]
fn sparse_entries_of_lights_that_stayed_do_not_expand_their_block() {
    let recipe = Recipe { n_cols: vec![16], rank: Ranks::Fixed(4), n_sparse: 0, ..Recipe::default() };
    let mut frame = recipe.frame();
    let block = Arc::make_mut(frame.groups[0].blocks[1].as_mut().unwrap());
    (0..4).for_each(|k| block.right[k * 16 + 3] = half::f16::ZERO);
    block.sparse = vec![clerestory_nystrom::SparseEntry { row: 2, col: 9, value: 1.5 }];
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut x = recipe.coefficients(1);
    relit(&mut relighter, &x);
    x[0][3] = [9.0; 3];
    relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_skipped, 1, "the light of the entry did not change");
    x[0][9] = [7.0; 3];
    let shown = relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_skipped, 0);
    assert_eq!(shown, relit(&mut CpuRelighter::new(&frame).unwrap(), &x));
}

#[test]
fn an_updated_block_is_the_only_one_read_and_gives_the_new_frame() {
    let recipe = Recipe { rank: Ranks::Fixed(6), ..Recipe::default() };
    let (mut frame, x) = (recipe.frame(), recipe.coefficients(1));
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    relit(&mut relighter, &x);
    let other = Recipe { seed: 9, ..recipe }.frame();
    frame.groups[0].blocks[2] = other.groups[0].blocks[2].clone();
    frame.groups[1].blocks[4] = None;
    relighter.update(&frame, &[(0, 2), (1, 4)]).unwrap();
    let updated = relit(&mut relighter, &x);
    assert_eq!(relighter.stats().n_expanded, 1);
    assert_eq!(updated, relit(&mut CpuRelighter::new(&frame).unwrap(), &x));

    let larger = Recipe { width: 50, ..Recipe::default() }.frame();
    relighter.update(&larger, &[]).unwrap();
    assert_eq!(relit(&mut relighter, &x), relit(&mut CpuRelighter::new(&larger).unwrap(), &x));
}

#[test]
fn wrong_input_is_refused_in_words() {
    let recipe = Recipe::default();
    let mut frame = recipe.frame();
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut refused = |x: &[Vec<[f32; 3]>]| relighter.relight(x, &mut Radiance::default()).unwrap_err();
    let mut x = recipe.coefficients(1);
    assert_eq!(refused(&x[..1]), RelightError::GroupCount { expected: 2, found: 1 });
    x[0][7][1] = f32::NAN;
    assert_eq!(refused(&x), RelightError::NotFinite { group: 0, col: 7 });
    x[1].push([0.0; 3]);
    x[0][7][1] = 0.0;
    assert_eq!(refused(&x), RelightError::ColumnCount { group: 1, expected: 1, found: 2 });

    let block = frame.groups[1].blocks.iter().position(|b| b.as_ref().is_some_and(|b| b.rank > 0)).unwrap();
    Arc::make_mut(frame.groups[1].blocks[block].as_mut().unwrap()).left.pop();
    assert!(matches!(CpuRelighter::new(&frame), Err(RelightError::Block { group: 1, .. })));
    assert!(relighter.update(&frame, &[(1, block)]).is_err());
    assert!(relighter.update(&frame, &[(1, 1000)]).is_err());
    frame.groups[0].bundle_len = 1;
    assert!(matches!(CpuRelighter::new(&frame), Err(RelightError::Frame(_))));

    // More blocks than there are tiles.
    let mut frame = recipe.frame();
    let last = frame.groups[0].blocks.len();
    let more = frame.groups[0].blocks[0].clone();
    frame.groups[0].blocks.push(more);
    assert!(matches!(relighter.update(&frame, &[(0, last)]), Err(RelightError::Frame(_))));
    relighter.relight(&recipe.coefficients(1), &mut Radiance::default()).unwrap();
}

#[test]
fn a_layer_is_added_to_every_picture_until_it_is_taken_away() {
    let recipe = Recipe { n_cols: vec![19, 1], tile: 5, ..Recipe::default() };
    let (frame, x) = (recipe.frame(), recipe.coefficients(3));
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let plain = relit(&mut relighter, &x);
    let pixels: Vec<[f32; 3]> = (0..plain.len()).map(|i| [i as f32, 0.5, -2.0 * i as f32]).collect();
    let layer = Arc::new(Radiance { width: frame.width, height: frame.height, pixels });
    let sums = |plain: &[[f32; 3]]| -> Vec<[f32; 3]> {
        let sum = |(a, b): (&[f32; 3], &[f32; 3])| [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
        plain.iter().zip(&layer.pixels).map(sum).collect()
    };
    relighter.set_layer(Some(&layer)).unwrap();
    assert_eq!(relit(&mut relighter, &x), sums(&plain));
    assert_eq!(relighter.stats().n_expanded, 0, "a layer reads no factor");
    let dark: Vec<_> = x.iter().map(|x| vec![[0.0; 3]; x.len()]).collect();
    assert_eq!(relit(&mut relighter, &dark), layer.pixels);
    relighter.set_layer(None).unwrap();
    assert_eq!(relit(&mut relighter, &x), plain);
}

#[test]
fn a_layer_that_does_not_fit_is_refused_and_the_one_before_stays() {
    let recipe = Recipe::default();
    let (frame, x) = (recipe.frame(), recipe.coefficients(1));
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let mut layer = Radiance::new(frame.width, frame.height);
    layer.pixels[3] = [1.0; 3];
    relighter.set_layer(Some(&Arc::new(layer.clone()))).unwrap();
    let before = relit(&mut relighter, &x);
    layer.pixels[7][1] = f32::NAN;
    let error = relighter.set_layer(Some(&Arc::new(layer)));
    assert_eq!(error, Err(RelightError::LayerNotFinite { pixel: 7 }));
    let error = relighter.set_layer(Some(&Arc::new(Radiance::new(frame.width + 1, frame.height))));
    assert!(matches!(error, Err(RelightError::LayerSize { .. })), "{error:?}");
    assert_eq!(relit(&mut relighter, &x), before);
}
