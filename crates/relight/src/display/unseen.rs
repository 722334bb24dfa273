//! How much radiance may change without being seen.
//!
//! A picture is a chain of clamps, matrices, curves and the sRGB encoding, all continuous; the encoding's two pieces meet
//! within 3e-8. So the largest slope of the whole chain, in the largest norm on both sides, bounds every change: of what no
//! channel of a pixel's radiance changes by more, no channel of the picture changes by more than half a byte's step. The slope counts what
//! one channel adds to the others through the matrices, and it is that of the chain as a whole: near black AgX itself
//! is six times as steep, where the encoding of what comes out is almost flat.

use super::false_color::STEEPEST_TURBO;
use super::{DisplayParams, Spacing, Tone, WhitePoint};

/// Half the distance between two bytes, of 1.
const HALF_STEP: f32 = 0.5 / 255.0;

impl DisplayParams {
    /// Nit by which each channel of radiance may change, whatever it is and up or down, so that no channel of the picture
    /// changes by more than half a step of 255 before it is rounded.
    pub fn unseen(&self) -> f32 {
        let slope = match &self.false_color {
            Some(scale) => {
                // Below its start a scale is flat; above, a logarithm is steepest where it starts.
                let bending = match scale.spacing {
                    Spacing::Log => std::f32::consts::LOG2_E / scale.low.max(f32::MIN_POSITIVE),
                    Spacing::Linear => 1.0,
                };
                STEEPEST_TURBO * scale.line().1 * bending
            }
            None => steepest(self.tone) * self.white.map_or(1.0, largest_gain) * self.gain(),
        };
        let unseen = HALF_STEP / slope;
        if unseen.is_finite() { unseen } else { 0.0 }
    }
}

/// Largest change of any encoded channel per change of all display-linear channels, for the curve and the sRGB encoding: found by
/// search over all colors in double precision (17.88, 13.70, 26.59, 12.95, 12.92), and a hundredth more. A test looks for more.
fn steepest(tone: Tone) -> f32 {
    match tone {
        // Where green and blue are below what the curve covers, and what they take off red bends with red.
        Tone::Agx => 18.1,
        Tone::Aces => 13.9,
        // Twice sRGB's own: what is least is taken off the others.
        Tone::Neutral => 26.9,
        Tone::Reinhard => 13.1,
        Tone::Linear => 13.05,
    }
}

/// Largest sum of magnitudes over a row of the matrix of white balance.
fn largest_gain(white: WhitePoint) -> f32 {
    let rows = white.matrix().map(|row| row.iter().map(|v| v.abs()).sum::<f32>());
    rows.into_iter().fold(0.0, f32::max)
}

#[cfg(test)]
mod tests {
    use super::super::exact::encoded;
    use super::*;
    use crate::display::ColorScale;
    use crate::synthetic::Random;

    /// Largest change in steps of 255 between colors whose channels differ by what is unseen, or not at all.
    fn largest_change(params: &DisplayParams, n_pairs: usize) -> f32 {
        let unseen = params.unseen();
        let white = if params.false_color.is_some() { 1.0 } else { 1.0 / params.gain() };
        let mut random = Random(7);
        let mut change = || {
            // Colors over 24 stops, one channel in ten black.
            let rgb = [(); 3]
                .map(|()| if random.below(10) == 0 { 0.0 } else { white * (12.0 * random.signed() - 5.0).exp2() });
            let moved = rgb.map(|v| (v + [-unseen, unseen, unseen, 0.0][random.below(4) as usize]).max(0.0));
            let (a, b) = (encoded(params, rgb), encoded(params, moved));
            (0..3).map(|i| 255.0 * (a[i] - b[i]).abs()).fold(0.0, f32::max)
        };
        (0..n_pairs).map(|_| change()).fold(0.0, f32::max)
    }

    #[test]
    fn what_is_unseen_changes_no_channel_by_more_than_half_a_step() {
        let warm = WhitePoint { kelvin: 2700.0, duv: 0.004 };
        for tone in Tone::ALL {
            for (exposure_ev, white) in [(-5.0, None), (0.0, None), (7.5, None), (1.0, Some(warm))] {
                let params = DisplayParams { tone, exposure_ev, white, ..DisplayParams::default() };
                let change = largest_change(&params, 200_000);
                assert!(change <= 0.5, "{params:?}: {change} steps");
                // White balance is bounded by itself.
                let least = if white.is_some() { 0.1 } else { 0.2 };
                assert!(change > least, "{params:?}: the bound is idle, {change} steps");
            }
        }
    }

    #[test]
    fn the_same_holds_of_false_color() {
        for spacing in [Spacing::Log, Spacing::Linear] {
            let scale = ColorScale { spacing, low: 0.5, high: 300.0 };
            let params = DisplayParams { false_color: Some(scale), ..DisplayParams::default() };
            let change = largest_change(&params, 200_000);
            assert!(change <= 0.5, "{spacing:?}: {change} steps");
            assert!(change > 0.1, "{spacing:?}: the bound is idle, {change} steps");
        }
    }

    #[test]
    fn a_stop_more_exposure_halves_what_is_unseen_and_extremes_are_never_unseen() {
        let at = |exposure_ev| DisplayParams { exposure_ev, ..DisplayParams::default() }.unseen();
        assert_eq!(at(3.0), 2.0 * at(4.0));
        assert_eq!(at(f32::NEG_INFINITY), 0.0, "black for ever is not a reason to stand still");
        assert_eq!(at(f32::INFINITY), 0.0);
    }
}
