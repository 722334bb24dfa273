//! Rows of irradiance beside those of radiance: what arrives, not what is seen.
//!
//! Each set of rows is a matrix of its own with the columns of the bake: scaled by its own peaks, compressed by the same
//! blocks, with an error measured in the same way. Blocks are numbered through all matrices, those of the picture first.

use std::sync::Arc;

use clerestory_nystrom::{BlockFactors, BlockLowRank, Partition};
use serde::{Deserialize, Serialize};

use crate::bake::{Bake, BakeHeader};
use crate::camera::Film;
use crate::figures::{ErrorDb, error_db};
use crate::light::LightRig;
use crate::matrix::CHANNELS;
use crate::sensors::SensorGrid;

/// What the rows of a matrix of irradiance are, three channels each, lux per channel.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum IrradianceRows {
    /// The front of the first diffuse surface that each pixel sees, the mean over its samples; a sample that sees none counts
    /// as dark.
    Pixels,
    /// Points of a plane.
    Grid(SensorGrid),
}

/// A matrix of irradiance in the header of a bake.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct IrradianceHeader {
    /// What its rows are.
    pub rows: IrradianceRows,
    /// What each column was multiplied by; coefficients are divided by it.
    pub column_scale: Vec<f32>,
    /// How much of each patch of the sky the pilots saw.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sky_reach: Vec<f32>,
    /// Mean square over the entries by which shared indirect light is off, as [`BakeHeader::sharing_bias`] for the picture.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sharing_bias: Option<f32>,
    /// Error of each column of lights, as [`BakeHeader::column_error`] for the picture.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub column_error: Vec<f32>,
}

impl IrradianceHeader {
    /// Before anything of its columns is known.
    pub(crate) fn unmeasured(rows: IrradianceRows, n_cols: usize) -> IrradianceHeader {
        let (column_scale, sky_reach, column_error) = (vec![1.0; n_cols], Vec::new(), Vec::new());
        IrradianceHeader { rows, column_scale, sky_reach, sharing_bias: None, column_error }
    }
}

/// Figures of a matrix of irradiance.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct IrradianceFigures {
    /// `pixels`, or the name of the grid.
    pub name: String,
    /// Pixels or points across.
    pub width: u32,
    /// Pixels or points down.
    pub height: u32,
    /// Mean rank over blocks, summed over the groups of columns.
    pub mean_rank: f32,
    /// Bytes of the factors.
    pub bytes: usize,
    /// Bytes of the dense matrix in 32-bit floats.
    pub dense_bytes: usize,
    /// Measured errors below the columns' peaks, of the points that are measured. The total is that of the light of the file, where that is
    /// worse: what is read of points is their light, and its error may be that of one column among hundreds.
    pub error_db: ErrorDb,
}

impl IrradianceRows {
    /// Rows over three, as a picture: that of the pixels, or the points of a grid.
    pub fn film(&self, pixels: Film) -> Film {
        match self {
            IrradianceRows::Pixels => pixels,
            IrradianceRows::Grid(SensorGrid { size: [width, height], .. }) => Film { width: *width, height: *height },
        }
    }

    /// Share of its rows that are measured: points of a work plane that stand on no floor hold nothing, and are off by nothing.
    fn measured_share(&self) -> f32 {
        match self {
            IrradianceRows::Pixels => 1.0,
            IrradianceRows::Grid(grid) => {
                let n_measured = grid.n_points().saturating_sub(grid.left_out.len());
                n_measured.max(1) as f32 / grid.n_points().max(1) as f32
            }
        }
    }

    /// For people and programs.
    pub fn name(&self) -> &str {
        match self {
            IrradianceRows::Pixels => "pixels",
            IrradianceRows::Grid(grid) => &grid.name,
        }
    }
}

impl BakeHeader {
    /// Size of a matrix of irradiance as a picture.
    pub fn irradiance_film(&self, set: usize) -> Film {
        self.irradiance[set].rows.film(Film { width: self.width, height: self.height })
    }

    /// Tiles of every matrix: of the picture, then of each matrix of irradiance.
    pub fn partitions(&self) -> Vec<Partition> {
        let sets = (0..self.irradiance.len()).map(|set| {
            let Film { width, height } = self.irradiance_film(set);
            Partition { width, height, tile: self.tile }
        });
        std::iter::once(self.partition()).chain(sets).collect()
    }

    /// No blocks yet: for every matrix one part per group of columns.
    pub(crate) fn empty_matrices(&self) -> Vec<Vec<BlockLowRank>> {
        let empty = |partition: Partition| -> Vec<BlockLowRank> {
            let n_cols = self.basis.groups.iter().map(|group| group.columns.len() as u32);
            n_cols.map(|n_cols| BlockLowRank::new(partition.clone(), CHANNELS as u32, n_cols)).collect()
        };
        self.partitions().into_iter().map(empty).collect()
    }

    /// The matrices of irradiance without blocks: for each one part per group of columns.
    pub fn empty_irradiance(&self) -> Vec<Vec<BlockLowRank>> {
        self.empty_matrices().split_off(1)
    }

    /// Whether the groups of a matrix of irradiance have columns of patches: what surfaces make of the light of free lamps.
    /// Previews and older programs left them dark without a sample; where samples found nothing that comes back, they are dark as well.
    pub fn holds_patches(&self, groups: &[BlockLowRank]) -> bool {
        let is_sampled = |group: &BlockLowRank| group.blocks.iter().flatten().any(|block| block.n_samples > 0);
        self.patches.is_some() && groups.last().is_some_and(is_sampled)
    }

    /// One RGB coefficient per column and group for a rig, as the factors of a matrix of irradiance take them.
    pub fn irradiance_coefficients(&self, set: usize, rig: &LightRig) -> Vec<Vec<[f32; 3]>> {
        self.scaled_coefficients(&self.irradiance[set].column_scale, rig)
    }

    /// The rows of irradiance that can be trusted.
    pub(crate) fn check_irradiance(&self) -> Result<(), &'static str> {
        let mut n_points = 0;
        for set in &self.irradiance {
            if let IrradianceRows::Grid(grid) = &set.rows {
                grid.check().map_err(|_| "its header has an impossible sensor grid")?;
                n_points += grid.n_points();
            }
            if set.column_scale.len() != self.basis.n_cols() {
                return Err("its header has rows of irradiance without a scale");
            }
            if set.column_scale.iter().any(|s| !s.is_finite() || *s <= 0.0) {
                return Err("its header has an impossible scale of irradiance");
            }
            if !self.is_of_columns(&set.column_error) {
                return Err("its header has impossible errors of columns of irradiance");
            }
            if set.sky_reach.iter().any(|reach| !reach.is_finite() || *reach < 0.0) {
                return Err("its header has an impossible reach of the sky");
            }
        }
        let n_pictures = self.irradiance.iter().filter(|set| set.rows == IrradianceRows::Pixels).count();
        let too_many = n_pictures > 1 || n_points > SensorGrid::MAX_POINTS;
        if too_many { Err("its header has too many rows of irradiance") } else { Ok(()) }
    }
}

impl Bake {
    /// The matrix of irradiance at the pixels, if it was baked.
    pub fn pixel_irradiance(&self) -> Option<usize> {
        self.header.pixel_irradiance(self.irradiance.len())
    }

    /// Every sensor grid with the number of its matrix.
    pub fn grids(&self) -> impl Iterator<Item = (usize, &SensorGrid)> {
        self.header.grids(self.irradiance.len())
    }

    /// What each matrix of irradiance cost and how exact it is.
    pub fn irradiance_figures(&self) -> Vec<IrradianceFigures> {
        let sets = self.header.irradiance.iter().zip(&self.irradiance).enumerate();
        let figures = sets.map(|(set, (header, groups))| {
            let film = self.header.irradiance_film(set);
            // The columns of patches are measured against lamps that no bake knows, not against lights of the scene.
            let of_lights = &groups[..groups.len() - usize::from(self.header.patches.is_some())];
            let mut error_db = error_db(of_lights, header.sharing_bias);
            if let Some(of_light) = self.header.light_error_db(set, of_lights) {
                error_db.total = error_db.total.min(of_light);
            }
            let error_db = error_db.of_share(header.rows.measured_share());
            IrradianceFigures {
                name: header.rows.name().into(),
                width: film.width,
                height: film.height,
                mean_rank: groups.iter().map(BlockLowRank::mean_rank).sum(),
                bytes: groups.iter().map(BlockLowRank::n_bytes).sum(),
                dense_bytes: CHANNELS * film.n_pixels() * self.header.basis.n_cols() * size_of::<f32>(),
                error_db,
            }
        });
        figures.collect()
    }
}

/// A block of all groups, if it is there.
pub(crate) fn block_of(groups: &[BlockLowRank], block_idx: usize) -> Option<Vec<Arc<BlockFactors>>> {
    groups.iter().map(|group| group.blocks[block_idx].clone()).collect()
}

/// Which matrix a block belongs to, and its number there; `None` beyond the last.
pub(crate) fn locate(partitions: &[Partition], mut block: usize) -> Option<(usize, usize)> {
    for (matrix, partition) in partitions.iter().enumerate() {
        if block < partition.n_blocks() {
            return Some((matrix, block));
        }
        block -= partition.n_blocks();
    }
    None
}

/// The number through all matrices of the first block of one.
pub(crate) fn first_block(partitions: &[Partition], matrix: usize) -> usize {
    partitions[..matrix].iter().map(Partition::n_blocks).sum()
}
