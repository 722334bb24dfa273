//! Errors light by light: a bake may be as exact as asked in the mean, and far worse in the column of one light, which reaches
//! few pixels by walks that are rare.

use clerestory_nystrom::{BlockFactors, BlockLowRank};
use rayon::prelude::*;
use serde::Serialize;

use crate::bake::{Bake, BakeHeader};
use crate::basis::{ColumnGroup, ColumnKind, LightBasis, LightSource};
use crate::error_maps::{Layer, Spread};
use crate::figures::BEST_DB;
use crate::irradiance::IrradianceHeader;
use crate::matrix::{CHANNELS, peak};

/// Lights that are named.
const N_WORST: usize = 3;
/// Pixels that tell how bright each column is, about.
const PEAK_PIXELS: usize = 2048;

/// Least error over the square of a peak: [`BEST_DB`].
const LEAST: f32 = 1e-12;
/// Peak of a column in its scale up to which it lights nothing: [`LEAST`] as a value, and what rounding leaves of black.
const DARK: f32 = 1e-6;

/// How the error is spread over the columns of lights, each below the peak of its own light in the picture, in dB: truncation and sampling,
/// without the bias of shared light, which is known in the mean alone. Columns that light nothing do not count.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ColumnErrorDb {
    /// Lights with the worst columns, the worst first, three at most.
    pub worst: Vec<LightErrorDb>,
    /// A tenth of the columns is worse.
    pub tenth: f32,
    /// Half of the columns is worse.
    pub median: f32,
}

/// The worst column of a light.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct LightErrorDb {
    /// Key of the light.
    pub light: String,
    /// Its error in dB.
    pub db: f32,
}

/// What is known of columns before they are packed.
pub(crate) struct BeforePacking {
    groups: Vec<GroupBefore>,
}

/// The same of a group.
struct GroupBefore {
    /// Mean square of each column's error.
    errors: Vec<f64>,
    /// Mean square of truncation.
    truncation: f32,
    /// Peak of each column. What packing does to a block is an error, and no light.
    peaks: Vec<f32>,
}

impl BeforePacking {
    /// Of the groups of lights of a picture, or of a matrix of irradiance; `None` where one of them does not tell.
    pub(crate) fn new(groups: &[BlockLowRank], basis: &LightBasis) -> Option<BeforePacking> {
        // Photographs may be darker than black: how far they are from it is what they show.
        let shown: fn(f32) -> f32 = if basis.is_measured() { f32::abs } else { std::convert::identity };
        let of_group = |group: &BlockLowRank| {
            let truncation = group.mean_error().truncation;
            Some(GroupBefore { errors: group.column_errors()?, truncation, peaks: peaks(group, shown) })
        };
        Some(BeforePacking { groups: groups.iter().map(of_group).collect::<Option<_>>()? })
    }

    /// [`BakeHeader::column_error`], or the same of a matrix of irradiance, given the same groups as they were packed. What packing adds is
    /// known in the mean alone, and counts in each column alike.
    pub(crate) fn after(self, packed: &[BlockLowRank], basis: &LightBasis) -> Vec<f32> {
        let of_group = |(before, (group, kind)): (GroupBefore, (&BlockLowRank, ColumnKind))| {
            let added = f64::from((group.mean_error().truncation - before.truncation).max(0.0));
            let relative = move |(error, peak): (f64, f32)| {
                if peak <= DARK {
                    return 0.0;
                }
                // Patches of the sky shine together: one scale and one peak are theirs.
                let peak = if kind == ColumnKind::Sky { 1.0 } else { peak };
                let relative = ((error + added) / f64::from(peak).powi(2)) as f32;
                if relative.is_finite() { rounded(relative) } else { 0.0 }
            };
            before.errors.into_iter().zip(before.peaks).map(relative).collect::<Vec<f32>>()
        };
        let kinds = basis.groups.iter().map(|group| group.kind);
        self.groups.into_iter().zip(packed.iter().zip(kinds)).flat_map(of_group).collect()
    }
}

/// Three digits, which a header holds in few bytes; above 0.
fn rounded(error: f32) -> f32 {
    format!("{:.2e}", error.max(LEAST)).parse().expect("a number in words is a number")
}

/// The 99.5 percentile of what each column shows in some pixels, light that is seen itself aside.
fn peaks(group: &BlockLowRank, shown: fn(f32) -> f32) -> Vec<f32> {
    let n_cols = group.n_cols as usize;
    let step = (group.n_rows() / (CHANNELS * PEAK_PIXELS)).max(1);
    let of_block = |(idx, block): (usize, &BlockFactors)| {
        let n_pixels = block.n_rows as usize / CHANNELS;
        // Not the same ones in each block.
        let pixels = (idx * (step / 3 + 1) % step..n_pixels).step_by(step);
        let mut rows = vec![0.0; CHANNELS * pixels.len() * n_cols];
        let wanted = pixels.flat_map(|pixel| (0..CHANNELS).map(move |channel| pixel * CHANNELS + channel));
        wanted.zip(rows.chunks_exact_mut(n_cols)).for_each(|(row, out)| block.low_rank_row(row, out));
        rows
    };
    let there: Vec<(usize, &BlockFactors)> =
        group.blocks.iter().enumerate().filter_map(|(idx, block)| Some((idx, block.as_deref()?))).collect();
    let rows: Vec<Vec<f32>> = there.into_par_iter().map(of_block).collect();
    let of_column = |column: usize| {
        let of_rows =
            |rows: &Vec<f32>| rows.iter().skip(column).step_by(n_cols).map(|value| shown(*value)).collect::<Vec<f32>>();
        let mut values: Vec<f32> = rows.iter().flat_map(of_rows).collect();
        if values.is_empty() { 0.0 } else { peak(&mut values, 0.0) }
    };
    (0..n_cols).into_par_iter().map(of_column).collect()
}

impl Bake {
    /// How the error is spread over the columns of lights; `None` where the bake does not tell.
    pub fn column_error_db(&self) -> Option<ColumnErrorDb> {
        self.header.column_error_db()
    }
}

impl BakeHeader {
    /// Error of the light of the file in a matrix of irradiance, given its groups of lights, below that light at the peaks of its columns,
    /// dB; what columns are off by is taken for independent. `None` where they do not tell.
    pub(crate) fn light_error_db(&self, set: usize, groups: &[BlockLowRank]) -> Option<f32> {
        let IrradianceHeader { column_scale, column_error, .. } = &self.irradiance[set];
        if column_error.is_empty() {
            return None;
        }
        // Errors are told over the squares of these.
        let peaks_of = |(group, of): (&BlockLowRank, &ColumnGroup)| match of.kind {
            ColumnKind::Sky => vec![1.0; group.n_cols as usize],
            _ => peaks(group, std::convert::identity),
        };
        let peaks = groups.iter().zip(&self.basis.groups).flat_map(peaks_of);
        let light = self.basis.file_light(column_scale);
        let (mut error, mut whole) = (0.0f64, 0.0f64);
        for ((light, own), peak) in light.iter().zip(column_error).zip(peaks).filter(|((_, own), _)| **own > 0.0) {
            let shown = f64::from(light.abs()) * f64::from(peak);
            error += shown * shown * f64::from(*own);
            whole += shown;
        }
        let db = (-10.0 * (error / (whole * whole)).log10()) as f32;
        db.is_finite().then(|| db.min(BEST_DB))
    }

    /// Whether errors of columns can be trusted: those of all columns of lights, or none.
    pub(crate) fn is_of_columns(&self, error: &[f32]) -> bool {
        let n_of_patches = self.basis.patch_columns().map_or(0, |columns| columns.len());
        let is_whole = error.is_empty() || error.len() == self.basis.n_cols().saturating_sub(n_of_patches);
        is_whole && error.iter().all(|error| error.is_finite() && *error >= 0.0)
    }

    fn column_error_db(&self) -> Option<ColumnErrorDb> {
        let in_db = |error: &f32| (*error > 0.0).then(|| (-10.0 * error.log10()).min(BEST_DB));
        let columns: Layer = self.column_error.iter().map(in_db).collect();
        let of_source = |source: &LightSource| {
            let own = columns.get(source.columns.start as usize..source.columns.end as usize)?;
            let db = own.iter().flatten().copied().reduce(f32::min)?;
            Some(LightErrorDb { light: source.key.clone(), db })
        };
        let mut worst: Vec<LightErrorDb> = self.basis.sources.iter().filter_map(of_source).collect();
        worst.sort_by(|a, b| a.db.total_cmp(&b.db));
        worst.truncate(N_WORST);
        let Spread { tenth, median, .. } = Spread::new(&columns);
        (!worst.is_empty()).then_some(ColumnErrorDb { worst, tenth, median })
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use clerestory_nystrom::{BlockError, Partition};

    use super::*;
    use crate::basis::SourceKind;

    const N_PIXELS: usize = 16;

    fn basis(kind: SourceKind) -> LightBasis {
        LightBasis::new(vec![LightSource::plain("a", kind, 0..1), LightSource::plain("b", kind, 0..1)])
    }

    /// A block of two columns of one value each.
    fn group(values: [f32; 2], truncation: f32) -> BlockLowRank {
        let left = [1.0; CHANNELS * N_PIXELS];
        let factors = BlockFactors::from_f32(&left, &values, left.len(), 2, 1);
        let error = BlockError { truncation, ..BlockError::default() };
        let block = BlockFactors { column_errors: vec![1e-4; 2], error, ..factors };
        let partition = Partition { width: N_PIXELS as u32, height: 1, tile: N_PIXELS as u32 };
        BlockLowRank { blocks: vec![Some(Arc::new(block))], ..BlockLowRank::new(partition, CHANNELS as u32, 2) }
    }

    #[test]
    fn what_packing_did_to_a_block_is_no_light() {
        let basis = basis(SourceKind::Point);
        let before = BeforePacking::new(&[group([1.0, 0.5], 1e-4)], &basis).unwrap();
        let told = before.after(&[group([100.0, 100.0], 1e-4 + 1e-2)], &basis);
        let expected: [f32; 2] = [1e-2 + 1e-4, (1e-2 + 1e-4) / 0.25];
        assert!(told.iter().zip(expected).all(|(told, error)| (told / error - 1.0).abs() < 0.01), "{told:?}");
    }

    #[test]
    fn a_column_far_below_its_scale_weighs_in_the_light_by_what_it_shows() {
        let bytes = include_bytes!("../tests/data/v3.transport");
        let read = crate::archive::decode(bytes, std::path::Path::new("a.transport")).unwrap();
        let mut header = BakeHeader { basis: basis(SourceKind::Point), ..BakeHeader::clone(&read.header) };
        header.irradiance[0].column_scale = vec![1.0; 2];
        // Each is off by 0.01.
        header.irradiance[0].column_error = vec![1e-4, 1.0];
        let told = header.light_error_db(0, &[group([1.0, 0.01], 0.0)]).unwrap();
        let expected = -10.0 * (2e-4 / 1.01f32.powi(2)).log10();
        assert!((told - expected).abs() < 0.05, "{told} dB, {expected} dB");
    }

    #[test]
    fn pictures_below_black_are_measured_by_how_far_they_are_from_it() {
        let told = |kind, values| {
            let basis = basis(kind);
            BeforePacking::new(&[group(values, 1e-4)], &basis).unwrap().after(&[group(values, 1e-4)], &basis)
        };
        let image = told(SourceKind::Image, [-1.0, 0.0]);
        assert!((image[0] / 1e-4 - 1.0).abs() < 0.01 && image[1] == 0.0, "{image:?}");
        assert_eq!(told(SourceKind::Point, [-1.0, 1e-7]), [0.0; 2], "they light nothing");
    }
}
