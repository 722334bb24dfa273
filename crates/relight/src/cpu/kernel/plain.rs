//! Portable: what the others are held against, and what the compiler makes vectors of where it can.

use half::{f16, slice::HalfFloatSliceExt};

use super::*;

pub(super) fn project<const N: usize>(rows: Rows<N>, cols: &Cols) -> Quad {
    let mut components = [[0.0; 3]; QUAD];
    for (halves, rgb) in rows.iter().zip(&mut components) {
        let mut right = [[0.0; LANES]; SEGMENT / LANES];
        halves.as_flattened().convert_to_f32_slice(right[..halves.len()].as_flattened_mut());
        let mut sums = [[0.0; LANES]; 3];
        for lanes in cols.lit {
            for (x, sums) in cols.x.iter().zip(&mut sums) {
                let terms = right[lanes].iter().zip(&x[lanes]);
                sums.iter_mut().zip(terms).for_each(|(sum, (right, x))| *sum += right * x);
            }
        }
        *rgb = sums.map(|lanes| lanes.iter().sum());
    }
    Quad::from_rgb(components)
}

pub(super) fn expand(left: &[f16], patterns: &[[f32; PATTERN]], out: &mut [f32]) {
    let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
    for (left, sums) in runs {
        sums.fill(0.0);
        for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
            let mut rows = [0.0; RUN];
            left.convert_to_f32_slice(&mut rows);
            for row in 0..RUN {
                sums[row] += rows[row] * z[row % 24];
            }
        }
    }
}
