//! Portable: what the others are held against, and what the compiler makes vectors of where it can.

use half::{f16, slice::HalfFloatSliceExt};

use super::*;

/// Entries as floats.
pub(in crate::cpu) trait Convert: Copy {
    fn convert(entries: &[Self], floats: &mut [f32]);
}

impl Convert for f16 {
    fn convert(entries: &[Self], floats: &mut [f32]) {
        entries.convert_to_f32_slice(floats);
    }
}

impl Convert for i8 {
    fn convert(entries: &[Self], floats: &mut [f32]) {
        floats.iter_mut().zip(entries).for_each(|(float, entry)| *float = f32::from(*entry));
    }
}

pub(super) fn project<T: Convert, const N: usize>(rows: Rows<T, N>, later: Rows<T, N>, cols: &Cols) -> Quad {
    prefetch(later);
    let mut components = [[0.0; 3]; QUAD];
    let mut right = [[[0.0; LANES]; N]; SEGMENT / LANES];
    T::convert(rows.as_flattened().as_flattened(), right[..rows.len()].as_flattened_mut().as_flattened_mut());
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

pub(super) fn expand<T: Convert>(
    left: &[T],
    later: &[T],
    patterns: &[[f32; PATTERN]],
    (write, out): (Write, &mut [f32]),
) {
    let mut later = later.as_chunks::<RUN>().0.iter();
    let runs = left.chunks_exact(patterns.len() * RUN).zip(out.as_chunks_mut::<RUN>().0);
    for (left, sums) in runs {
        if write == Write::Set {
            sums.fill(0.0);
        }
        for (left, z) in left.as_chunks::<RUN>().0.iter().zip(patterns) {
            later.next().into_iter().for_each(|later| prefetch(later));
            let mut rows = [0.0; RUN];
            T::convert(left, &mut rows);
            for row in 0..RUN {
                sums[row] += rows[row] * z[row % 24];
            }
        }
    }
}
