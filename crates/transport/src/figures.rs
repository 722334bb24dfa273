//! What a bake cost and how exact it is.

use clerestory_nystrom::{BlockLowRank, PackedMatrix};
use serde::Serialize;

use crate::bake::{Bake, BakeConfig};
use crate::basis::{LightSource, SourceKind};
use crate::column_errors::ColumnErrorDb;
use crate::error_maps::BlockErrorDb;
use crate::light::LightRig;
use crate::matrix::CHANNELS;
use crate::reach::is_beyond;
use crate::skips::Skip;
use crate::sky::dome_columns;

/// Errors in dB below the columns' peaks: 10·log10(pk² / mean ΔT²) over all entries outside the sparse part.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct ErrorDb {
    /// What the chosen ranks leave out: each half of the samples judged by the other. Of blocks that were smoothed what is left
    /// of the smoothed halves, and what smoothing is expected to lose; of lamps that are kept apart nothing. In a file with what
    /// packing takes off. Where noise leaves an estimate below nothing, its size is told: more than that may be left out unseen.
    pub truncation: f32,
    /// Sampling noise that stays in the factors; where pixels tell each other, as Stein's estimate has it.
    pub sampling: f32,
    /// Sampling noise of the entries before compression.
    pub noise: f32,
    /// Off by sharing indirect light, measured on pixels that were traced as well; `None` where all light was traced.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bias: Option<f32>,
    /// All of them but the noise together; a truncation that is estimated below nothing does not count.
    pub total: f32,
}

/// Work that was not needed. What is saved is estimated from the samples that were taken.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Skipped {
    /// Blocks, over all groups, that hold no light at all.
    pub dark_blocks: usize,
    /// Columns that hold no light in a block, summed over the blocks.
    pub dark_columns: usize,
    /// Blocks that reached the tolerance before all samples were taken; 0 where a time ended the bake, and left some without them.
    pub converged_blocks: usize,
    /// Share of the samples that were not taken, 0 as well where a time ended the bake.
    pub samples_saved: f32,
    /// Patches of the sky that nothing in the picture was seen to receive light from.
    pub sky_patches: usize,
    /// Columns of sky, sun and directional lamps that closed walls keep out.
    pub closed_sky_columns: usize,
    /// Columns of lamps and panels that cannot light what is seen.
    pub dark_lamp_columns: usize,
    /// Connections that all these columns (of a sky those of its patches) and patches would have taken at first vertices alone, one for
    /// each and sample.
    pub connections_saved: f64,
    /// Share of the later connections that was left to roulette, in a few pixels.
    pub weak_connections: f32,
    /// Pixels that see nothing.
    pub empty_pixels: usize,
    /// Rays of the camera that would have met nothing.
    pub camera_rays_saved: f64,
    /// Materials that are diffuse and nothing else: a number less for each scattering.
    pub diffuse_materials: usize,
    /// Random numbers that would have chosen among their lobes at first vertices alone, one a sample, were surfaces met by their area.
    pub random_numbers_saved: f64,
    /// Triangles that are never asked for their alpha.
    pub opaque_triangles: usize,
    /// Times that rays of the camera alone would have asked them, one a sample, were surfaces met by their area.
    pub alpha_tests_saved: f64,
    /// Images that were not decoded.
    pub idle_images: usize,
    /// Bytes of their texels, of those whose size was at hand.
    pub idle_image_bytes: u64,
    /// Columns that were taken over from an earlier bake.
    pub reused_columns: usize,
    /// Connections that these would have taken at first vertices alone, one for each and sample, but for those that are in
    /// `connections_saved`.
    pub reused_connections_saved: f64,
    /// What could have been skipped and was not, as asked.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub off: Vec<Skip>,
}

/// Figures of the columns that free lamps light.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PatchFigures {
    /// Patches of surface.
    pub patches: usize,
    /// Points at which they ask for irradiance.
    pub samples: usize,
    /// Columns that stand for them.
    pub columns: usize,
    /// See [`crate::patches::Patches::held_out_error`].
    pub held_out_error: f32,
    /// Mean rank over blocks.
    pub mean_rank: f32,
    /// Bytes of their factors in the file; `None` while a bake runs.
    pub file_bytes: Option<usize>,
    /// Errors below the root mean square of the picture that a lamp makes by way of patches.
    pub error_db: ErrorDb,
}

/// Figures of a finished bake.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Figures {
    /// Pixels of the picture.
    pub pixels: usize,
    /// Columns of the matrix.
    pub columns: usize,
    /// Blocks of pixels.
    pub blocks: usize,
    /// Blocks that a time left as the preview made them, with shared and clamped indirect light.
    pub preview_blocks: usize,
    /// Lamps that have a rank in common in each block of the picture instead of being kept apart; one alone may lack what is weak of it.
    pub lamps_together: usize,
    /// Mean rank over blocks, summed over the groups of columns.
    pub mean_rank: f32,
    /// Highest rank of a block, summed over the groups of columns.
    pub max_rank: u32,
    /// Memory of the factors, in bytes.
    pub bytes: usize,
    /// Bytes of the packed factors, as the file holds them; `None` while a bake runs, and for files of older programs.
    pub file_bytes: Option<usize>,
    /// Bytes of the dense matrix in 32-bit floats.
    pub dense_bytes: usize,
    /// Dense over the bytes of the file, or over those in memory where there is no packed form.
    pub ratio: f32,
    /// Measured errors, of the columns of the scene's own lights.
    pub error_db: ErrorDb,
    /// How they are spread over these columns; `None` where the file does not tell.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub column_error_db: Option<ColumnErrorDb>,
    /// The method, if the factors are none of its own.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub reconstruction: Option<Reconstruction>,
    /// Columns that free lamps light, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub patches: Option<PatchFigures>,
    /// How they are spread over the blocks.
    pub block_error_db: BlockErrorDb,
    /// Work that was not needed.
    pub skipped: Skipped,
}

/// A method whose own form is no pair of factors: these are all entries of what it makes of each block. The errors are its
/// own; ranks and sizes are not.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Reconstruction {
    /// Name of the method.
    pub method: String,
    /// Why its own form is another one, in words.
    pub why: &'static str,
}

/// Best error that is told; beyond it numbers mean nothing in 16-bit factors.
pub(crate) const BEST_DB: f32 = 120.0;

/// Errors of all groups together, each entry counting alike; `bias` is the mean square by which shared light is off.
pub fn error_db(groups: &[BlockLowRank], bias: Option<f32>) -> ErrorDb {
    let mut sum = [0.0f64; 3];
    let mut weight = 0.0;
    for group in groups.iter().filter(|g| g.blocks.iter().any(Option::is_some)) {
        let error = group.mean_error();
        let entries = group.n_rows() as f64 * f64::from(group.n_cols);
        for (sum, value) in sum.iter_mut().zip([error.truncation, error.sampling, error.noise]) {
            *sum += f64::from(value) * entries;
        }
        weight += entries;
    }
    let db = |mean_square: f64| {
        let db = -10.0 * (mean_square / weight.max(1.0)).max(0.0).log10();
        (db as f32).min(BEST_DB)
    };
    let truncation = sum[0].max(0.0);
    let biased = bias.map(|mean_square| f64::from(mean_square) * weight.max(1.0));
    ErrorDb {
        // What is below nothing is off by at least as much.
        truncation: db(sum[0].abs()),
        sampling: db(sum[1]),
        noise: db(sum[2]),
        bias: biased.map(db),
        total: db(truncation + sum[1] + biased.unwrap_or(0.0)),
    }
}

impl ErrorDb {
    /// The same where only a share of all entries was there to be off, above 0 and at most 1.
    pub(crate) fn of_share(self, share: f32) -> ErrorDb {
        let of = |db: f32| if db < BEST_DB { db + 10.0 * share.log10() } else { db };
        ErrorDb {
            truncation: of(self.truncation),
            sampling: of(self.sampling),
            noise: of(self.noise),
            bias: self.bias.map(of),
            total: of(self.total),
        }
    }
}

/// Columns of a light that first vertices connect to: of a sky its patches alone, not those of its map and of what is seen of it, and none of
/// what is only met.
fn n_connected(source: &LightSource) -> usize {
    match source.kind {
        SourceKind::Sky | SourceKind::Constant | SourceKind::Image => 0,
        SourceKind::Dome { divisions } => source.columns.len().min(dome_columns(divisions) as usize - 2),
        _ => source.columns.len(),
    }
}

impl BakeConfig {
    /// The method, if its own form is no pair of factors and a bake holds what it makes of each block in full.
    pub fn reconstruction(&self) -> Option<Reconstruction> {
        Some(Reconstruction { method: self.method.to_string(), why: self.method.without_factors()? })
    }
}

impl Bake {
    /// What it cost and how exact it is.
    pub fn figures(&self) -> Figures {
        let blocks = self.header.partition().n_blocks();
        let (pixels, columns) = (self.header.width as usize * self.header.height as usize, self.header.basis.n_cols());
        let bytes = self.groups.iter().map(BlockLowRank::n_bytes).sum::<usize>();
        let packed = self.packed.as_ref().and_then(|matrices| matrices.first());
        let file_bytes = packed.map(|groups| groups.iter().map(PackedMatrix::n_bytes).sum::<usize>());
        let dense_bytes = CHANNELS * pixels * columns * size_of::<f32>();
        Figures {
            pixels,
            columns,
            blocks,
            preview_blocks: self.header.preview_blocks as usize,
            lamps_together: self.header.n_lamps_together(),
            mean_rank: self.groups.iter().map(|g| g.mean_rank()).sum(),
            max_rank: (0..blocks).map(|block_idx| self.rank(block_idx)).max().unwrap_or(0),
            bytes,
            file_bytes,
            dense_bytes,
            ratio: dense_bytes as f32 / file_bytes.unwrap_or(bytes).max(1) as f32,
            error_db: error_db(self.groups_of_lights(), self.header.sharing_bias),
            column_error_db: self.column_error_db(),
            reconstruction: self.header.config.reconstruction(),
            patches: self.patch_figures(),
            block_error_db: self.error_maps().spread(),
            skipped: self.skipped(),
        }
    }

    /// The groups of columns that lights of the scene own.
    pub(crate) fn groups_of_lights(&self) -> &[BlockLowRank] {
        &self.groups[..self.groups.len() - usize::from(self.header.patches.is_some())]
    }

    /// Whether nothing can be seen, whatever the lights do: no light of the scene reaches what the camera sees, nor would lamps
    /// by way of patches.
    pub fn is_dark(&self) -> bool {
        let groups = self.groups_under(&LightRig::default());
        groups.iter().flat_map(|group| group.blocks.iter().flatten()).all(|b| b.rank == 0 && b.sparse.is_empty())
    }

    fn patch_figures(&self) -> Option<PatchFigures> {
        let (patches, group) = (self.header.patches.as_ref()?, self.groups.last()?);
        let packed = self.packed.as_ref().and_then(|matrices| matrices.first()?.last());
        Some(PatchFigures {
            patches: patches.n_patches(),
            samples: patches.samples().len(),
            columns: patches.n_columns(),
            held_out_error: patches.held_out_error(),
            mean_rank: group.mean_rank(),
            file_bytes: packed.map(PackedMatrix::n_bytes),
            error_db: error_db(std::slice::from_ref(group), None),
        })
    }

    /// Rank of a block, summed over the groups of columns.
    pub(crate) fn rank(&self, block_idx: usize) -> u32 {
        self.groups.iter().filter_map(|group| Some(group.blocks.get(block_idx)?.as_ref()?.rank)).sum()
    }

    /// Samples of a block, the mean over the columns of lights: groups that were taken over from an earlier bake have their own.
    pub(crate) fn samples(&self, block_idx: usize) -> Option<f64> {
        let groups = if self.groups_of_lights().is_empty() { &self.groups[..] } else { self.groups_of_lights() };
        let of_group = |group: &BlockLowRank| {
            let (block, n_cols) = (group.blocks.get(block_idx)?.as_ref()?, f64::from(group.n_cols));
            Some([f64::from(block.n_samples) * n_cols, n_cols])
        };
        let [sum, n_cols] = groups.iter().filter_map(of_group).reduce(|a, b| [a[0] + b[0], a[1] + b[1]])?;
        Some(sum / n_cols)
    }

    fn skipped(&self) -> Skipped {
        let factors = || self.groups.iter().flat_map(|g| g.blocks.iter().flatten());
        let full = 2 * self.header.config.samples_per_half();
        let taken: Vec<f64> =
            (0..self.header.partition().n_blocks()).filter_map(|block_idx| self.samples(block_idx)).collect();
        let share = taken.iter().sum::<f64>() / (f64::from(full) * taken.len().max(1) as f64);
        let (header, spared) = (&self.header, &self.header.spared);
        let dark = spared.dark_sources.iter().filter_map(|&source| header.basis.sources.get(source as usize));
        let (closed, lamps): (Vec<_>, Vec<_>) = dark.partition(|source| is_beyond(source.kind));
        let columns = |sources: &[&LightSource]| sources.iter().map(|source| source.columns.len()).sum::<usize>();
        let (closed_sky_columns, dark_lamp_columns) = (columns(&closed), columns(&lamps));
        // Where pilots saw nothing of any patch, all are connected to.
        let learns = header.skips.has(Skip::UnseenPatches) && header.sky_reach.iter().any(|reach| *reach > 0.0);
        let unseen = header.sky_reach.iter().filter(|reach| learns && **reach <= 0.0).count();
        // What a time left out was not needless.
        let asked_for: &[f64] = if header.ended_by_time { &[] } else { &taken };
        // Columns that were taken over come first. Those among them that nobody connects to would have taken no connection.
        let is_reused = |source: &LightSource| source.columns.end <= spared.reused_columns;
        let connected = |sources: &[&LightSource]| sources.iter().map(|source| n_connected(source)).sum::<usize>();
        let reused: Vec<&LightSource> = header.basis.sources.iter().filter(|source| is_reused(source)).collect();
        let reused_dark: Vec<&LightSource> = closed.iter().chain(&lamps).copied().filter(|s| is_reused(s)).collect();
        let has_reused_dome = reused.iter().any(|source| matches!(source.kind, SourceKind::Dome { .. }));
        let reused_unseen = if has_reused_dome { unseen } else { 0 };
        let reused_and_lit = connected(&reused).saturating_sub(connected(&reused_dark) + reused_unseen);
        let samples_per_pixel = share * f64::from(full);
        let n_pixels = f64::from(header.width) * f64::from(header.height);
        // A pixel that sees nothing has no first vertex.
        let samples = samples_per_pixel * (n_pixels - f64::from(spared.empty_pixels)).max(0.0);
        let saved = |per_sample: f64| (samples * per_sample).round();
        Skipped {
            closed_sky_columns,
            dark_lamp_columns,
            connections_saved: saved((connected(&closed) + connected(&lamps) + unseen) as f64),
            weak_connections: spared.weak_connections,
            empty_pixels: spared.empty_pixels as usize,
            camera_rays_saved: (samples_per_pixel * f64::from(spared.empty_pixels)).round(),
            diffuse_materials: spared.diffuse_materials as usize,
            random_numbers_saved: saved(f64::from(spared.diffuse_share)),
            opaque_triangles: spared.opaque_triangles as usize,
            alpha_tests_saved: saved(f64::from(spared.opaque_share)),
            idle_images: spared.idle_images as usize,
            idle_image_bytes: spared.idle_bytes,
            reused_columns: spared.reused_columns as usize,
            reused_connections_saved: saved(reused_and_lit as f64),
            off: header.skips.off(),
            sky_patches: unseen,
            dark_columns: factors().map(|block| block.n_zero_columns()).sum(),
            dark_blocks: factors().filter(|b| b.rank == 0 && b.sparse.is_empty()).count(),
            converged_blocks: asked_for.iter().filter(|&&n| n < f64::from(full)).count(),
            samples_saved: if asked_for.is_empty() { 0.0 } else { (1.0 - share).max(0.0) as f32 },
        }
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use clerestory_nystrom::{BlockError, BlockFactors, Partition};

    use super::*;

    #[test]
    fn an_estimate_below_nothing_is_not_told_as_nothing() {
        let of = |truncation: f32| {
            let mut group = BlockLowRank::new(Partition { width: 4, height: 4, tile: 4 }, CHANNELS as u32, 2);
            let error = BlockError { truncation, sampling: 1e-3, noise: 1e-2 };
            group.blocks[0] = Some(Arc::new(BlockFactors { n_rows: 48, n_cols: 2, error, ..BlockFactors::default() }));
            error_db(&[group], None)
        };
        let [above, none, below] = [1e-4, 0.0, -1e-4].map(of);
        assert!((above.truncation - 40.0).abs() < 1e-3 && none.truncation == BEST_DB, "{above:?} {none:?}");
        assert_eq!(below.truncation, above.truncation, "{below:?}");
        assert_eq!(below.total, none.total, "{below:?}");
    }
}
