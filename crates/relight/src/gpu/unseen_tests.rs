//! Changes that nobody sees, left out on a device.

use super::tests::{assert_ends_where_a_fresh_relight_does, gpu, relit};
use super::*;
use crate::cpu::unseen_tests::{difference, of_two_changes};
use crate::synthetic::{Ranks, Recipe};
use crate::{DisplayParams, Frame, Radiance, Relight, Tone};

/// Rounding of single precision on the device, steps of 255.
const ROUNDING: f32 = 2e-3;

fn recipe() -> Recipe {
    Recipe { n_cols: vec![19, 70], rank: Ranks::Fixed(5), n_sparse: 0, ..Recipe::default() }
}

fn exact(gpu: &Gpu, frame: &Frame, x: &[Vec<[f32; 3]>]) -> Radiance {
    relit(&mut GpuRelighter::new(gpu, frame).unwrap(), x)
}

fn shown(relighter: &GpuRelighter) -> Radiance {
    let mut out = Radiance::default();
    relighter.read_radiance(&mut out).unwrap();
    out
}

#[test]
fn a_texture_without_what_is_not_seen_agrees_to_half_a_step() {
    let Some(gpu) = gpu() else { return };
    let (recipe, frame) = (recipe(), recipe().frame());
    for tone in [Tone::Agx, Tone::Linear] {
        let display = DisplayParams { tone, exposure_ev: -5.0, ..DisplayParams::default() };
        let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
        let mut x = recipe.coefficients(1);
        let (mut largest, mut n_behind) = (0f32, 0);
        for step in 0..40 {
            x[1][5] = [0.3 + 4e-6 * (step * step) as f32, 0.4, 0.2 + 1e-5 * step as f32];
            relighter.relight_to_texture(&x, &display).unwrap();
            let difference = difference(&display, &shown(&relighter), &exact(&gpu, &frame, &x));
            (largest, n_behind) = (largest.max(difference), n_behind + usize::from(difference > 10.0 * ROUNDING));
        }
        assert!(largest <= 0.5 + ROUNDING, "{tone:?}: {largest} steps");
        assert!(n_behind > 10, "{tone:?}: nothing was left out");
        let fresh = exact(&gpu, &frame, &x);
        assert!(difference(&display, &relit(&mut relighter, &x), &fresh) <= ROUNDING, "the exact answer does without");
    }
}

#[test]
fn what_a_texture_lacks_comes_with_more_exposure_and_when_another_group_moves() {
    let Some(gpu) = gpu() else { return };
    let (recipe, frame) = (recipe(), recipe().frame());
    let dark = DisplayParams { exposure_ev: -12.0, ..DisplayParams::default() };
    let bright = DisplayParams { exposure_ev: -3.0, ..dark };
    let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
    let mut x = recipe.coefficients(1);
    let fall_behind = |relighter: &mut GpuRelighter, x: &mut Vec<Vec<[f32; 3]>>| {
        x[1][5][1] += 1.0;
        relighter.relight_to_texture(x, &dark).unwrap();
        x[1][5][1] += 0.01;
        relighter.relight_to_texture(x, &dark).unwrap();
        let behind = difference(&bright, &shown(relighter), &exact(&gpu, &frame, x));
        assert!(behind > 0.5, "it would be seen under more exposure, {behind}");
    };
    // The first picture sums all groups, from the second on one moves alone.
    relighter.relight_to_texture(&x, &dark).unwrap();
    fall_behind(&mut relighter, &mut x);
    relighter.relight_to_texture(&x, &bright).unwrap();
    assert_eq!(relighter.stats().n_submitted, 1);
    assert!(difference(&bright, &shown(&relighter), &exact(&gpu, &frame, &x)) <= 0.5 + ROUNDING);

    // All that was behind is made up for, so that still more exposure is display alone.
    let brighter = DisplayParams { exposure_ev: 2.0, ..dark };
    relighter.relight_to_texture(&x, &brighter).unwrap();
    assert_eq!((relighter.stats().n_submitted, relighter.stats().n_expanded), (1, 0));
    assert!(difference(&brighter, &shown(&relighter), &exact(&gpu, &frame, &x)) <= 0.1);

    fall_behind(&mut relighter, &mut x);
    x[0][3] = [0.9; 3];
    relighter.relight_to_texture(&x, &dark).unwrap();
    assert!(difference(&bright, &shown(&relighter), &exact(&gpu, &frame, &x)) <= ROUNDING, "it was summed as it is");
}

#[test]
fn groups_that_move_together_share_half_a_step_and_leave_no_drift() {
    for gpu in super::twin_tests::gpus() {
        let recipe = Recipe { n_cols: vec![19, 70, 3], n_sparse: 1, ..recipe() };
        let frame = recipe.frame();
        let display = DisplayParams { tone: Tone::Linear, exposure_ev: -5.0, ..DisplayParams::default() };
        let mut relighter = GpuRelighter::new(&gpu, &frame).unwrap();
        let mut x = recipe.coefficients(1);
        relighter.relight_to_texture(&x, &display).unwrap();
        let (mut largest, mut n_behind, mut n_expanded) = (0f32, 0, 0);
        for step in 0..40 {
            x[1][5] = [0.3 + 4e-6 * (step * step) as f32, 0.4, 0.2 + 1e-5 * step as f32];
            x[0][3][1] += 1e-5 * (step % 3) as f32;
            relighter.relight_to_texture(&x, &display).unwrap();
            n_expanded = relighter.stats().n_expanded;
            let difference = difference(&display, &shown(&relighter), &exact(&gpu, &frame, &x));
            (largest, n_behind) = (largest.max(difference), n_behind + usize::from(difference > 10.0 * ROUNDING));
        }
        assert!(largest <= 0.5 + ROUNDING, "{largest} steps");
        assert!(n_behind > 10, "nothing was left out, {n_behind}, {largest}");
        assert_eq!(n_expanded, 2 * frame.partition().n_blocks(), "the group that stays is not read");
        assert_ends_where_a_fresh_relight_does(&gpu, &frame, &mut relighter, &x);
    }
}

#[test]
fn two_changes_that_nobody_sees_alone_are_seen_together() {
    let (frame, display, before, change) = of_two_changes();
    for gpu in super::twin_tests::gpus() {
        let after = |groups: &[usize]| {
            let (mut relighter, mut x) = (GpuRelighter::new(&gpu, &frame).unwrap(), before.clone());
            let mut add = |change: f32| {
                groups.iter().for_each(|&group| x[group][0].iter_mut().for_each(|x| *x += change));
                relighter.relight_to_texture(&x, &display).unwrap();
            };
            // The groups are seen to move before they move by what is not seen.
            [0.0, 3.0 * change, 0.0, change].into_iter().for_each(&mut add);
            difference(&display, &shown(&relighter), &exact(&gpu, &frame, &x))
        };
        for alone in [0, 1] {
            assert!((0.38..0.42).contains(&after(&[alone])), "group {alone}: {} steps are left out", after(&[alone]));
        }
        assert!(after(&[0, 1]) <= 0.5 + ROUNDING, "{} steps", after(&[0, 1]));
    }
}
