//! White balance: what light of a chosen white point looks like to eyes that are used to it.
//!
//! Colors are adapted from that white point to D65, the white of the display, by von Kries scaling of cone responses in
//! Bradford's space \[Lam1985\], with the matrix as \[Lindbloom2017\] gives it. The white point is a temperature on the
//! Planckian locus \[Kim2002\], the one that lamps set in kelvin take, and a distance from it.

use super::curves::mul;

/// The light that is shown as neutral.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WhitePoint {
    /// Correlated color temperature, clamped to 1667 … 25000 K.
    pub kelvin: f32,
    /// Distance from the Planckian locus in CIE 1960 (u, v): positive towards green, negative towards magenta.
    pub duv: f32,
}

type Matrix = [[f64; 3]; 3];

/// Row-major.
const BRADFORD: Matrix = [[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]];
const BRADFORD_INVERSE: Matrix = [
    [0.986_992_9, -0.147_054_3, 0.159_962_7],
    [0.432_305_3, 0.518_360_3, 0.049_291_2],
    [-0.008_528_7, 0.040_042_8, 0.968_486_7],
];
/// Row-major, linear Rec. 709 with the white D65 \[Lindbloom2017\].
const XYZ_FROM_RGB: Matrix = [
    [0.412_456_4, 0.357_576_1, 0.180_437_5],
    [0.212_672_9, 0.715_152_2, 0.072_175],
    [0.019_333_9, 0.119_192, 0.950_304_1],
];
const RGB_FROM_XYZ: Matrix = [
    [3.240_454_2, -1.537_138_5, -0.498_531_4],
    [-0.969_266, 1.876_010_8, 0.041_556],
    [0.055_643_4, -0.204_025_9, 1.057_225_2],
];
/// XYZ of D65, luminance 1.
const D65: [f64; 3] = [0.950_47, 1.0, 1.088_83];

/// Temperatures that the locus is known for.
const KELVIN: [f64; 2] = [1667.0, 25_000.0];

impl WhitePoint {
    /// Chromaticity (x, y), CIE 1931.
    pub fn xy(self) -> [f64; 2] {
        let kelvin = if self.kelvin.is_finite() { f64::from(self.kelvin).clamp(KELVIN[0], KELVIN[1]) } else { 6504.0 };
        let at = |t: f64| uv_of_xy(planckian_xy(t.clamp(KELVIN[0], KELVIN[1])));
        let [u, v] = at(kelvin);

        // Towards hotter the locus runs to smaller u and v, so green lies to its right.
        let ([u_0, v_0], [u_1, v_1]) = (at(kelvin / 1.01), at(kelvin * 1.01));
        let (du, dv) = (u_1 - u_0, v_1 - v_0);
        let step = f64::from(self.duv) / du.hypot(dv);
        xy_of_uv([u + step * dv, v - step * du])
    }

    /// Row-major; adapts linear Rec. 709 so that this white point comes out neutral at the same luminance.
    pub fn matrix(self) -> [[f32; 3]; 3] {
        let [x, y] = self.xy();
        let white = [x / y, 1.0, (1.0 - x - y) / y];
        let adapted = product(&RGB_FROM_XYZ, &product(&adaptation(white, D65), &XYZ_FROM_RGB));
        adapted.map(|row| row.map(|v| v as f32))
    }
}

/// Display-linear color under a matrix of [`WhitePoint::matrix`], within what curves take.
pub(super) fn balanced(matrix: &[[f32; 3]; 3], rgb: [f32; 3]) -> [f32; 3] {
    mul(matrix, rgb).map(|v| v.clamp(0.0, super::MOST))
}

/// XYZ to XYZ, from one white to another.
fn adaptation(from: [f64; 3], to: [f64; 3]) -> Matrix {
    let (from, to) = (times(&BRADFORD, from), times(&BRADFORD, to));
    let scaled: Matrix = std::array::from_fn(|i| BRADFORD[i].map(|v| v * to[i] / from[i]));
    product(&BRADFORD_INVERSE, &scaled)
}

/// Rational fit of the Planckian locus \[Kim2002\].
fn planckian_xy(t: f64) -> [f64; 2] {
    let x = if t <= 4000.0 {
        -0.266_123_9e9 / t.powi(3) - 0.234_358_9e6 / t.powi(2) + 0.877_695_6e3 / t + 0.179_910
    } else {
        -3.025_846_9e9 / t.powi(3) + 2.107_037_9e6 / t.powi(2) + 0.222_634_7e3 / t + 0.240_390
    };
    let y = if t <= 2222.0 {
        -1.106_381_4 * x.powi(3) - 1.348_110_2 * x.powi(2) + 2.185_558_32 * x - 0.202_196_83
    } else if t <= 4000.0 {
        -0.954_947_6 * x.powi(3) - 1.374_185_93 * x.powi(2) + 2.091_370_15 * x - 0.167_488_67
    } else {
        3.081_758 * x.powi(3) - 5.873_386_7 * x.powi(2) + 3.751_129_97 * x - 0.370_014_83
    };
    [x, y]
}

fn uv_of_xy([x, y]: [f64; 2]) -> [f64; 2] {
    let d = -2.0 * x + 12.0 * y + 3.0;
    [4.0 * x / d, 6.0 * y / d]
}

fn xy_of_uv([u, v]: [f64; 2]) -> [f64; 2] {
    let d = 2.0 * u - 8.0 * v + 4.0;
    [3.0 * u / d, 2.0 * v / d]
}

fn product(a: &Matrix, b: &Matrix) -> Matrix {
    a.map(|row| std::array::from_fn(|col| (0..3).map(|k| row[k] * b[k][col]).sum()))
}

fn times(m: &Matrix, v: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * v[0] + row[1] * v[1] + row[2] * v[2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn adaptation_from_illuminant_a_and_d50_is_the_published_one() {
        // Both matrices to D65 as [Lindbloom2017] lists them.
        let of_a = adaptation([1.0985, 1.0, 0.355_85], D65);
        let of_d50 = adaptation([0.964_22, 1.0, 0.825_21], D65);
        let published_a = [
            [0.844_696_5, -0.117_922_5, 0.394_810_8],
            [-0.136_630_3, 1.104_122_6, 0.129_171_8],
            [0.079_848_9, -0.134_899_9, 3.192_400_9],
        ];
        let published_d50 = [
            [0.955_576_6, -0.023_039_3, 0.063_163_6],
            [-0.028_289_5, 1.009_941_6, 0.021_007_7],
            [0.012_298_2, -0.020_483, 1.329_909_8],
        ];
        for (found, published) in [(of_a, published_a), (of_d50, published_d50)] {
            for (a, b) in found.as_flattened().iter().zip(published.as_flattened()) {
                assert!((a - b).abs() < 1e-5, "{a} instead of {b}");
            }
        }
    }

    #[test]
    fn the_white_point_comes_out_neutral_at_its_own_luminance() {
        for (kelvin, duv) in [(1800.0, 0.0), (2700.0, 0.0), (4000.0, 0.006), (6504.0, -0.004), (20_000.0, 0.0)] {
            let white = WhitePoint { kelvin, duv };
            let [x, y] = white.xy();
            let rgb = times(&RGB_FROM_XYZ, [x / y, 1.0, (1.0 - x - y) / y]).map(|v| v as f32);
            for v in mul(&white.matrix(), rgb) {
                assert!((v - 1.0).abs() < 2e-5, "{kelvin} K, {duv}: {v}");
            }
        }
    }

    #[test]
    fn daylight_of_6504_kelvin_lies_3_thousandths_above_the_locus_and_needs_no_balance() {
        let white = WhitePoint { kelvin: 6504.0, duv: 0.0032 };
        let [x, y] = white.xy();
        assert!((x - 0.3127).abs() < 3e-4 && (y - 0.329).abs() < 3e-4, "{x} {y}");
        for (row, line) in white.matrix().iter().enumerate() {
            for (col, v) in line.iter().enumerate() {
                assert!((v - f32::from(u8::from(row == col))).abs() < 5e-3, "{row} {col}: {v}");
            }
        }
    }

    #[test]
    fn a_warm_white_point_cools_the_picture_and_duv_takes_green_out() {
        let [r, _, b] = mul(&WhitePoint { kelvin: 3000.0, duv: 0.0 }.matrix(), [1.0; 3]);
        assert!(r < 0.9 && b > 1.5, "{r} {b}");
        let [r, g, b] = mul(&WhitePoint { kelvin: 6504.0, duv: 0.02 }.matrix(), [1.0; 3]);
        assert!(g < r && g < b, "{r} {g} {b}");
    }
}
