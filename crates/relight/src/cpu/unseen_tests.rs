//! Changes that nobody sees.

use super::*;
use crate::display::exact::encoded;
use crate::synthetic::{Ranks, Recipe};
use crate::{DisplayParams, Tone};

fn recipe() -> Recipe {
    Recipe { n_cols: vec![19, 70], rank: Ranks::Fixed(5), n_sparse: 1, ..Recipe::default() }
}

fn exact(frame: &Frame, x: &[Vec<[f32; 3]>]) -> Radiance {
    let mut out = Radiance::default();
    CpuRelighter::new(frame).unwrap().relight(x, &mut out).unwrap();
    out
}

/// Largest difference of two pictures in steps of 255, before bytes are rounded.
pub(crate) fn difference(display: &DisplayParams, a: &Radiance, b: &Radiance) -> f32 {
    let of_pixel = |(a, b): (&[f32; 3], &[f32; 3])| {
        let (a, b) = (encoded(display, *a), encoded(display, *b));
        (0..3).map(|i| 255.0 * (a[i] - b[i]).abs()).fold(0.0, f32::max)
    };
    a.pixels.iter().zip(&b.pixels).map(of_pixel).fold(0.0, f32::max)
}

/// A dark picture of two groups of one column each, the same everywhere, of which a change is as large as can be told; and a change of
/// each that alone is 0.4 steps.
pub(crate) fn of_two_changes() -> (Frame, DisplayParams, Vec<Vec<[f32; 3]>>, f32) {
    let recipe =
        Recipe { n_cols: vec![1, 1, 1], rank: Ranks::Fixed(1), n_sparse: 0, is_positive: true, ..Recipe::default() };
    let mut frame = recipe.frame();
    for block in frame.groups.iter_mut().flat_map(|group| &mut group.blocks).flatten() {
        let block = std::sync::Arc::make_mut(block);
        block.left.fill(half::f16::ONE);
        block.right.fill(half::f16::ONE);
        block.scale.fill(1.0);
    }
    // Where sRGB is a straight line.
    let display = DisplayParams { tone: Tone::Linear, exposure_ev: 0.0, ..DisplayParams::default() };
    let dark = 1e-3 / display.gain();
    let x = vec![vec![[0.3 * dark; 3]], vec![[0.3 * dark; 3]], vec![[0.1 * dark; 3]]];
    let mut brighter = x.clone();
    brighter[0][0] = [0.6 * dark; 3];
    let steps = difference(&display, &exact(&frame, &x), &exact(&frame, &brighter));
    (frame, display, x, 0.4 * 0.3 * dark / steps)
}

/// Displays under which a synthetic picture is neither black nor white.
fn displays() -> impl Iterator<Item = DisplayParams> {
    Tone::ALL.into_iter().map(|tone| DisplayParams { tone, exposure_ev: -5.0, ..DisplayParams::default() })
}

#[test]
fn a_picture_without_what_is_not_seen_agrees_to_half_a_step() {
    let (recipe, frame) = (recipe(), recipe().frame());
    for display in displays() {
        let mut relighter = CpuRelighter::new(&frame).unwrap();
        let (mut x, mut out) = (recipe.coefficients(1), Radiance::default());
        let (mut n_unseen, mut n_expanded, mut largest) = (0, 0, 0f32);
        for step in 0..200 {
            // A slider, and a second one that moves a little as well.
            x[1][5] = [0.3 + 4e-6 * (step * step) as f32, 0.4, 0.2 + 1e-5 * step as f32];
            x[0][3][1] += 3e-6;
            relighter.relight_for_display(&x, &display, &mut out).unwrap();
            (n_unseen, n_expanded) = (n_unseen + relighter.stats().n_unseen, n_expanded + relighter.stats().n_expanded);
            largest = largest.max(difference(&display, &out, &exact(&frame, &x)));
        }
        assert!(largest <= 0.5, "{display:?}: {largest} steps");
        assert!(largest > 0.0 && n_unseen > 100, "{display:?}: nothing was left out, {n_unseen}, {largest}");
        assert!(n_expanded > 200, "{display:?}: what is left out adds up, {n_expanded}");

        relighter.relight(&x, &mut out).unwrap();
        assert_eq!(out, exact(&frame, &x), "the exact answer does without");
    }
}

#[test]
fn what_was_not_seen_is_made_up_for_under_more_exposure() {
    let (recipe, frame) = (recipe(), recipe().frame());
    let mut display = DisplayParams { exposure_ev: -12.0, ..DisplayParams::default() };
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let (mut x, mut out) = (recipe.coefficients(1), Radiance::default());
    relighter.relight_for_display(&x, &display, &mut out).unwrap();
    x[1][5][0] += 0.01;
    relighter.relight_for_display(&x, &display, &mut out).unwrap();
    assert!(relighter.stats().n_unseen > 0);
    display.exposure_ev = -3.0;
    assert!(difference(&display, &out, &exact(&frame, &x)) > 0.5, "it would be seen now");
    relighter.relight_for_display(&x, &display, &mut out).unwrap();
    assert!(relighter.stats().n_expanded > 0);
    assert!(difference(&display, &out, &exact(&frame, &x)) <= 0.5);
}

#[test]
fn a_column_that_a_tile_does_not_see_leaves_it_exact_and_nothing_to_make_up_for() {
    let (recipe, mut frame) = (recipe(), recipe().frame());
    let n_cols = frame.groups[1].n_cols as usize;
    for block in frame.groups[1].blocks.iter_mut().flatten() {
        let block = std::sync::Arc::make_mut(block);
        block.right.iter_mut().skip(5).step_by(n_cols).for_each(|entry| *entry = half::f16::ZERO);
        block.sparse.clear();
    }
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let (mut x, mut out) = (recipe.coefficients(1), Radiance::default());
    relighter.relight(&x, &mut out).unwrap();
    x[1][5] = [7.0, 8.0, 9.0];
    relighter.relight(&x, &mut out).unwrap();
    assert_eq!((relighter.stats().n_expanded, relighter.stats().n_unseen), (0, 0), "it misses nothing");
    // So half a step is left for the other group, and no factor of this one is read again.
    relighter.relight_for_display(&x, &displays().next().unwrap(), &mut out).unwrap();
    assert_eq!((relighter.stats().n_bytes, relighter.stats().n_unseen), (0, 0));
    assert_eq!(out, exact(&frame, &x));
}

#[test]
fn ten_thousand_increments_for_a_display_leave_no_drift() {
    let recipe = Recipe { width: 20, height: 9, n_cols: vec![150, 9], rank: Ranks::Mixed(6), ..Recipe::default() };
    let frame = recipe.frame();
    let display = DisplayParams { exposure_ev: -6.0, ..DisplayParams::default() };
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    let (mut x, mut out, mut n_unseen) = (recipe.coefficients(1), Radiance::default(), 0);
    for step in 0..10_000usize {
        let (group, col) = if step % 5 == 0 { (1, step % 9) } else { (0, step * 7 % 150) };
        x[group][col] = x[group][col].map(|v| (v + 1e-4 * (step % 7) as f32).min(1.0));
        relighter.relight_for_display(&x, &display, &mut out).unwrap();
        n_unseen += relighter.stats().n_unseen;
    }
    assert!(n_unseen > 1000, "{n_unseen}");
    assert!(difference(&display, &out, &exact(&frame, &x)) <= 0.5);
    relighter.relight(&x, &mut out).unwrap();
    assert_eq!(out, exact(&frame, &x));
}

#[test]
fn what_one_group_misses_is_not_left_for_the_others_and_none_of_it_is_lost() {
    let recipe = Recipe { n_cols: vec![19, 70, 9], ..recipe() };
    let frame = recipe.frame();
    let display = DisplayParams { tone: Tone::Linear, exposure_ev: -5.0, ..DisplayParams::default() };
    let relit = |relighter: &mut CpuRelighter, x: &[Vec<[f32; 3]>]| {
        let mut out = Radiance::default();
        relighter.relight_for_display(x, &display, &mut out).unwrap();
        (relighter.stats().n_unseen, difference(&display, &out, &exact(&frame, x)))
    };
    let mut x = recipe.coefficients(1);
    let mut relighter = CpuRelighter::new(&frame).unwrap();
    relit(&mut relighter, &x);
    // One group alone may miss more than a third of half a step.
    let mut most_alone = 0f32;
    for _ in 0..300 {
        x[1][5][0] += 2e-5;
        most_alone = most_alone.max(relit(&mut relighter, &x).1);
    }
    assert!(most_alone > 0.5 / 3.0 && most_alone <= 0.5, "{most_alone} steps alone");
    let (mut most, mut n_unseen) = (0f32, 0);
    for step in 0..300 {
        x[step % 2][5][0] += 3e-5;
        x[2][3][step % 3] += 1e-5;
        let (unseen, difference) = relit(&mut relighter, &x);
        (most, n_unseen) = (most.max(difference), n_unseen + unseen);
    }
    assert!(most > 0.1 && most <= 0.5 && n_unseen > 100, "{most} steps together, {n_unseen} left out");
    let mut out = Radiance::default();
    relighter.relight(&x, &mut out).unwrap();
    assert_eq!(out, exact(&frame, &x));
}

#[test]
fn two_changes_that_nobody_sees_alone_are_seen_together() {
    let (frame, display, x, change) = of_two_changes();
    let after = |groups: &[usize]| {
        let mut relighter = CpuRelighter::new(&frame).unwrap();
        let (mut x, mut out) = (x.clone(), Radiance::default());
        relighter.relight_for_display(&x, &display, &mut out).unwrap();
        groups.iter().for_each(|&group| x[group][0].iter_mut().for_each(|x| *x += change));
        relighter.relight_for_display(&x, &display, &mut out).unwrap();
        difference(&display, &out, &exact(&frame, &x))
    };
    for alone in [0, 1] {
        assert!((0.39..0.41).contains(&after(&[alone])), "group {alone}: {} steps are left out", after(&[alone]));
    }
    assert!(after(&[0, 1]) <= 0.5, "{} steps", after(&[0, 1]));
}
