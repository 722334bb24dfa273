//! Portable: what the others are held against, and what the compiler makes vectors of where it can.

use half::{f16, slice::HalfFloatSliceExt};

use super::*;

pub(super) fn project<const N: usize>(rows: Rows<N>, later: Rows<N>, cols: &Cols) -> Quad {
    prefetch(later);
    let mut components = [[0.0; 3]; QUAD];
    let mut right = [[[0.0; LANES]; N]; SEGMENT / LANES];
    rows.as_flattened().as_flattened().convert_to_f32_slice(right[..rows.len()].as_flattened_mut().as_flattened_mut());
    for (component, rgb) in components.iter_mut().enumerate().take(N) {
        let mut sums = [[0.0; LANES]; 3];
        for lanes in cols.lit {
            for (x, sums) in cols.x.iter().zip(&mut sums) {
                let terms = right[lanes][component].iter().zip(&x[lanes]);
                sums.iter_mut().zip(terms).for_each(|(sum, (right, x))| *sum += right * x);
            }
        }
        *rgb = sums.map(|lanes| lanes.iter().sum());
    }
    Quad::from_rgb(components)
}

pub(super) fn expand(left: &[f16], later: &[f16], patterns: &[[f32; PATTERN]], out: &mut [f32]) {
    let mut later = later.as_chunks::<RUN>().0.iter();
    let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
    for (left, sums) in runs {
        sums.fill(0.0);
        for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
            later.next().into_iter().for_each(|later| prefetch(later));
            let mut rows = [0.0; RUN];
            left.convert_to_f32_slice(&mut rows);
            for row in 0..RUN {
                sums[row] += rows[row] * z[row % 24];
            }
        }
    }
}
