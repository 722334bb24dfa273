//! Colors that a file states other primaries for, into linear Rec. 709.

use exr::meta::attribute::Chromaticities;
use exr::prelude::Vec2;
use glam::{DMat3, DVec3, Mat3, Vec3};

use crate::light::REC709_FROM_XYZ;

/// Coordinates of a chromaticity that differ by no more mean the same.
const SAME: f32 = 0.01;
/// Red, green, blue and white of Rec. 709, CIE 1931 (x, y).
const REC709: [[f32; 2]; 4] = [[0.64, 0.33], [0.3, 0.6], [0.15, 0.06], [0.3127, 0.329]];
/// XYZ of D65, luminance 1.
const D65: DVec3 = DVec3::new(0.950_47, 1.0, 1.088_83);
/// Columns are the cone responses to X, Y and Z. \[Lam1985\]
const BRADFORD: DMat3 = DMat3::from_cols_array(&[
    0.8951, -0.7502, 0.0389, //
    0.2664, 1.7135, -0.0685, //
    -0.1614, 0.0367, 1.0296,
]);

/// Makes linear colors of the stated primaries those of Rec. 709, their white D65 by von Kries scaling in Bradford's space
/// \[Lam1985\]; `None` where they are that already.
///
/// # Errors
/// Primaries between which there are no colors, in words.
pub(super) fn into_rec709(stated: &Chromaticities) -> Result<Option<DMat3>, String> {
    let Chromaticities { red, green, blue, white } = *stated;
    into_rec709_from([red, green, blue, white].map(|Vec2(x, y)| [x, y]), "chromaticities")
}

/// The same of red, green, blue and white in CIE 1931 (x, y), which a file states as `name`.
///
/// # Errors
/// As [`into_rec709`].
pub(super) fn into_rec709_from(stated: [[f32; 2]; 4], name: &str) -> Result<Option<DMat3>, String> {
    let pairs = || stated.iter().flatten().zip(REC709.iter().flatten());
    if pairs().all(|(stated, own)| (stated - own).abs() <= SAME) {
        return Ok(None);
    }
    let [red, green, blue, white] =
        stated.map(|[x, y]| DVec3::new(x.into(), y.into(), 1.0 - f64::from(x) - f64::from(y)));
    let (primaries, white) = (DMat3::from_cols(red, green, blue), white / white.y);
    let luminances = primaries.inverse() * white;
    let (from, to) = (BRADFORD * white, BRADFORD * D65);
    let adapted = BRADFORD.inverse() * DMat3::from_diagonal(to / from) * BRADFORD;
    let matrix = REC709_FROM_XYZ * adapted * primaries * DMat3::from_diagonal(luminances);
    if !(matrix.is_finite() && luminances.min_element() > 0.0) {
        return Err(format!(
            "its `{name}` {stated:?} are no primaries with a white between them and are passed over: its colors are taken as those of Rec. 709; write it with \
             those of its colors, or without"
        ));
    }
    Ok(Some(matrix))
}

/// A pixel that was converted. One with a channel that is infinite or no number stays as it is.
pub(super) fn converted(matrix: &Mat3, pixel: [f32; 3]) -> [f32; 3] {
    let is_finite = pixel.iter().all(|value| value.is_finite());
    if is_finite { (*matrix * Vec3::from(pixel)).to_array() } else { pixel }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stated(primaries: [[f32; 2]; 4]) -> Chromaticities {
        let [red, green, blue, white] = primaries.map(|[x, y]| Vec2(x, y));
        Chromaticities { red, green, blue, white }
    }

    #[test]
    fn aces_and_p3_become_rec_709_by_the_published_matrices() {
        // AP0 with the white of ACES, by Bradford, as the Academy's transforms have it; P3 with D65.
        let aces =
            [[2.521_69, -1.134_13, -0.387_56], [-0.276_48, 1.372_72, -0.096_24], [-0.015_38, -0.152_98, 1.168_35]];
        let p3 = [[1.2249, -0.2247, 0.0], [-0.0420, 1.0419, 0.0], [-0.0197, -0.0786, 1.0979]];
        let ap0 = [[0.7347, 0.2653], [0.0, 1.0], [0.0001, -0.077], [0.32168, 0.33767]];
        let display = [[0.68, 0.32], [0.265, 0.69], [0.15, 0.06], [0.3127, 0.329]];
        for (primaries, expected) in [(ap0, aces), (display, p3)] {
            let matrix = into_rec709(&stated(primaries)).expect("primaries").expect("others");
            for (row, expected) in expected.iter().enumerate() {
                let difference = matrix.row(row) - DVec3::from(*expected);
                assert!(difference.abs().max_element() < 5e-4, "{:?} {expected:?}", matrix.row(row));
            }
        }
    }

    #[test]
    fn rec_709_stays_as_it_is_and_nonsense_is_told() {
        let rounded = [[0.6401, 0.33], [0.3, 0.6], [0.15, 0.0605], [0.3127, 0.329]];
        assert_eq!(into_rec709(&stated(rounded)), Ok(None));
        let [red, green, blue, white] = REC709;
        for primaries in [
            [[0.0; 2]; 4],
            [red, green, blue, [0.0; 2]],
            [red, red, blue, white],
            [red, green, [f32::NAN, 0.06], white],
            [red, green, blue, [0.7, 0.2]],
        ] {
            let why = into_rec709(&stated(primaries)).expect_err("no primaries");
            assert!(why.contains("chromaticities"), "{why}");
        }
    }

    #[test]
    fn what_overflowed_stays_infinite() {
        let matrix = Mat3::from_cols_array(&[2.0, -0.5, -0.5, -1.0, 2.0, 0.0, 0.0, -0.5, 1.5]);
        let pixels = [[f32::INFINITY, 1.0, 1.0], [1.0; 3]];
        assert_eq!(pixels.map(|pixel| converted(&matrix, pixel)), pixels);
    }
}
