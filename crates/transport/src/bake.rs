//! The bake: from a scene and a camera to block factors, coarse first, in the background if need be.
//!
//! A bake is a value: the same scene, camera, film and config give the same bytes on any number of threads, but where a time ends it
//! ([`Passes::Until`]) or columns of an earlier bake are taken over ([`reuse`]).

mod clock;
mod denoise;
mod ending;
mod enlarge;
pub mod estimate;
#[cfg(test)]
mod floor;
pub mod focus;
mod grounds;
mod irradiance;
mod key;
mod method;
mod packing;
mod patches;
pub mod reuse;
pub mod stack;

use std::ops::ControlFlow;
use std::sync::Arc;
use std::time::{Duration, Instant};

use clerestory_nystrom::rivals::Method;
use clerestory_nystrom::{
    BlockFactors, BlockLowRank, ColumnGroup, CompressConfig, CompressError, Guide, PackedMatrix, Partition, SamplePlan,
    Smoothing, Tolerance, compress_by,
};
use clock::Clock;
use focus::Focus;
use glam::Vec3;
pub use grounds::Grounds;
use serde::{Deserialize, Serialize};
use thiserror::Error;

use self::patches::PatchBlocks;
use crate::archive::ArchiveError;
use crate::basis::{ColumnKind, LightBasis};
use crate::cache::CachePlan;
use crate::camera::{Camera, Film};
use crate::emitters::LightingError;
use crate::empty::EmptyPixels;
use crate::figures::ErrorDb;
use crate::fingerprint::fingerprint;
use crate::guides::Guides;
use crate::import::stack::StackError;
use crate::irradiance::{IrradianceHeader, IrradianceRows, locate};
use crate::light::LightRig;
use crate::matrix::{CHANNELS, TransportMatrix};
use crate::nodes::{NodePlan, Nodes};
use crate::patches::{PatchSample, Patches};
use crate::plan::{Density, MatrixPlan};
use crate::prepared::PreparedScene;
use crate::reach::dark_sources;
use crate::sensors::{SensorError, SensorGrid};
use crate::shared::SharedMatrix;
use crate::skips::{Skip, Skips, Spared};

/// Why a bake ended without a result.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum BakeError {
    /// The scene has nothing to see.
    #[error("the scene has no triangles; open a file with meshes")]
    NoTriangles,
    /// The picture would be empty or absurdly large.
    #[error("a picture of {width}×{height} pixels cannot be baked; give 1 to {max} a side", max = Film::MAX_SIDE)]
    Size {
        /// Width asked for.
        width: u32,
        /// Height asked for.
        height: u32,
    },
    /// A setting out of range.
    #[error("{what}")]
    Config {
        /// What is wrong, and what is allowed.
        what: String,
    },
    /// The lights of the scene cannot be used as asked.
    #[error(transparent)]
    Lighting(#[from] LightingError),
    /// The sensors cannot be laid as asked.
    #[error(transparent)]
    Sensors(#[from] SensorError),
    /// The pictures of a stack cannot be used.
    #[error(transparent)]
    Stack(#[from] StackError),
    /// Compression failed.
    #[error(transparent)]
    Compress(#[from] CompressError),
    /// The result could not be kept.
    #[error(transparent)]
    Archive(#[from] ArchiveError),
}

/// How exactly a scene is baked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BakeConfig {
    /// Most samples per pixel, both halves together; at least one is taken for each half.
    pub spp: u32,
    /// Truncation and sampling error at which a block is done, in dB: 10·log10(pk² / mean ΔT²).
    pub tolerance_db: f32,
    /// Scattering events beyond the first; `None` leaves the end to roulette.
    pub bounces: Option<u32>,
    /// Same seed, same bytes.
    pub seed: u64,
    /// Where the light between surfaces comes from.
    #[serde(default)]
    pub indirect: Indirect,
    /// What makes factors of the samples, in the last pass; all but the default are there for comparison. Of one
    /// [without factors](Method::without_factors) all entries of what it makes are kept.
    #[serde(default, with = "method", skip_serializing_if = "method::is_default")]
    pub method: Method,
    /// Patches that free lamps may light, about; 0 for none.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub patches: u32,
    /// Whether noise is taken out where pixels that show the same surface tell each other, as far as both halves of the samples
    /// say that it helps. Bakes of before have none of it.
    #[serde(default)]
    pub denoise: bool,
    /// Whether blocks that are noisier than asked are [smoothed](Smoothing). Without it nothing is done to single lights but
    /// truncation, and a block may be worse than its samples.
    #[serde(default = "yes", skip_serializing_if = "is_yes")]
    pub smooth: bool,
    /// Side of a block in pixels, one of [`SIDES`].
    #[serde(default = "usual_side", skip_serializing_if = "is_usual_side")]
    pub block: u32,
}

/// How the light that surfaces send to each other is found.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Indirect {
    /// Gathered for several pixels at once where it falls on a diffuse base: sooner, but smoothed over a few pixels, a bias
    /// that the measured error does not hold.
    Shared,
    /// Followed from every sample of every pixel: without bias.
    #[default]
    Traced,
}

impl Indirect {
    /// Walks of a node for each half, of the preview and of a bake; and at which tolerance a bake takes the least.
    const PREVIEW_WALKS: u32 = 8;
    const NODE_WALKS: [u32; 2] = [16, 512];
    const LEAST_UP_TO_DB: f32 = 30.0;
    /// Walks of a cell for each half.
    const CELL_WALKS: u32 = 16;

    /// Nodes of a pass with some samples per half; `None` is the preview.
    fn nodes(self, samples: Option<u32>, tolerance_db: f32) -> Option<NodePlan> {
        let cache = CachePlan { walks: Indirect::CELL_WALKS, places_per_cell: 2 };
        match (samples, self) {
            (None, _) => {
                let cache = CachePlan { walks: Indirect::CELL_WALKS / 2, places_per_cell: 10 };
                Some(NodePlan { walks: Indirect::PREVIEW_WALKS, outshines: 2.0, cache })
            }
            (Some(_), Indirect::Traced) => None,
            (Some(n), Indirect::Shared) => {
                let [least, most] = Indirect::NODE_WALKS;
                // As exact as the tolerance asks for, but not far beyond what so few samples reach.
                let asked = least as f32 * 10f32.powf(0.1 * (tolerance_db - Indirect::LEAST_UP_TO_DB));
                let walks = (asked as u32).min(n.saturating_mul(8)).clamp(least, most);
                Some(NodePlan { walks, outshines: 4.0, cache })
            }
        }
    }
}

impl BakeConfig {
    /// What a pass with some samples per half aims at, dB; `None` is a preview.
    fn tolerance_of(&self, samples: Option<u32>) -> f32 {
        if samples.is_some() { self.tolerance_db } else { self.tolerance_db.min(PREVIEW_DB) }
    }

    /// Samples per pixel of each half, at most.
    pub(crate) fn samples_per_half(&self) -> u32 {
        (self.spp / 2).max(1)
    }

    /// Whether each block is to hold traced light as it was sampled, and none is to hold that of a preview.
    fn is_exact(&self) -> bool {
        self.indirect == Indirect::Traced && !self.denoise && !self.smooth
    }

    /// Greatest rank of a block. What other methods are asked to fit holds noise, which they do not know from signal: with every rank
    /// open to them, most would take minutes for each block.
    fn max_rank(&self) -> u32 {
        match self.method {
            Method::Projected | Method::Svd => most_rank(self.block),
            _ => RIVAL_RANK,
        }
    }
}

/// Rows of a block, which no rank is above.
fn most_rank(block: u32) -> u32 {
    CHANNELS as u32 * block * block
}

impl Default for BakeConfig {
    fn default() -> Self {
        let (indirect, method) = (Indirect::default(), Method::default());
        let (spp, tolerance_db) = (256, 40.0);
        let (patches, denoise, smooth) = (0, true, true);
        BakeConfig {
            spp,
            tolerance_db,
            bounces: None,
            seed: 0,
            indirect,
            method,
            patches,
            denoise,
            smooth,
            block: SIDE,
        }
    }
}

fn is_zero(n: &u32) -> bool {
    *n == 0
}

fn yes() -> bool {
    true
}

fn is_yes(answer: &bool) -> bool {
    *answer
}

fn is_no(answer: &bool) -> bool {
    !*answer
}

fn usual_side() -> u32 {
    SIDE
}

fn is_usual_side(side: &u32) -> bool {
    *side == SIDE
}

/// Which passes run before the last one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Passes {
    /// A preview in which lamps are told apart however weak they are, a pass with a sixteenth of the samples, then all of them: for
    /// somebody who watches.
    #[default]
    Progressive,
    /// The same preview, of what pixels show at their centers: for somebody who leaves when it is there, as others will be told by them
    /// ([`BakeJob::enlarged`]).
    FirstLook,
    /// A preview, then all samples.
    PreviewAndFinal,
    /// All samples at once.
    FinalOnly,
    /// What was begun before, as it is; of the rest a preview, then all samples: for somebody who has not seen it yet.
    Again,
    /// A preview, then passes of four times the samples each, until then at the latest: blocks that the pass under way has not
    /// reached stay as the pass before left them. Where neither noise is taken out nor light shared, each block is traced once all the
    /// same. What comes out depends on the speed of the machine.
    Until(Instant),
}

impl Passes {
    fn deadline(self) -> Option<Instant> {
        if let Passes::Until(deadline) = self { Some(deadline) } else { None }
    }
}

/// Samples per half at which a block is first asked whether it is exact enough; more where indirect light is traced, since
/// a half that met a rare bright walk early would keep it undiluted.
const FIRST_LOOK_SHARED: u32 = 1;
const FIRST_LOOK_TRACED: u32 = 4;

/// Samples per half of the first pass of those that grow until a time is up.
const FIRST_OF_GROWING: u32 = 4;

/// Columns of a group that are kept as they were sampled, in all passes and in a preview for somebody who watches, and bytes that all of
/// these may take. Where a lamp has less light than noise, a rank that holds no noise gives it that of the others, block by block:
/// under that lamp alone the picture falls into squares.
const LAMPS_APART: usize = 32;
const LAMPS_APART_IN_PREVIEWS: usize = 64;
const LAMPS_APART_BYTES: usize = 1 << 30;

/// What a preview aims at where more is asked for: it has no time for ranks that hold nothing but noise.
const PREVIEW_DB: f32 = 24.0;

/// Root mean square of a block, the peak of a column being 1, from which on it is not dark: what is dark beside the peak is seen
/// as well as it under a light of its own.
const BRIGHT: f32 = 0.25;

/// Side of a block in pixels, unless another one is asked for.
pub const SIDE: u32 = 16;
/// Sides that may be asked for.
pub const SIDES: [u32; 3] = [8, 16, 32];

/// Greatest rank of a block by a method that is there for comparison.
const RIVAL_RANK: u32 = 96;

/// What there is to bake.
#[derive(Clone)]
pub struct BakeJob {
    /// The scene with its lights.
    pub scene: Arc<PreparedScene>,
    /// Where it is seen from.
    pub camera: Camera,
    /// Size of the picture.
    pub film: Film,
    /// How exactly.
    pub config: BakeConfig,
    /// Which passes.
    pub passes: Passes,
    /// Rows of irradiance beside the radiance of the pixels; none for most bakes.
    pub irradiance: Vec<IrradianceRows>,
}

/// What a baked matrix is of; with the factors it is all that relighting needs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BakeHeader {
    /// Name of the scene.
    pub scene: String,
    /// Hash of everything in the scene that light can meet.
    pub fingerprint: String,
    /// Name of the camera.
    pub camera: String,
    /// The camera itself, where the sky is shown behind the picture, free lamps may light it, or the scene has no such camera.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub view: Option<Camera>,
    /// Pixels across.
    pub width: u32,
    /// Pixels down.
    pub height: u32,
    /// Side of a block in pixels.
    pub tile: u32,
    /// How exactly it was baked.
    pub config: BakeConfig,
    /// The columns.
    pub basis: LightBasis,
    /// What each column was multiplied by; coefficients are divided by it.
    pub column_scale: Vec<f32>,
    /// How much of each patch of the sky the pilots saw; what they saw nothing of is not connected to.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub sky_reach: Vec<f32>,
    /// Mean square over the entries by which shared indirect light is off; known at the end of a bake that shares it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sharing_bias: Option<f32>,
    /// Blocks of the picture that a time left as the preview made them, whose indirect light is shared and clamped.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub preview_blocks: u32,
    /// Whether a time ended the bake before its last pass had come to all blocks: what samples a block lacks, it may have needed.
    #[serde(default, skip_serializing_if = "is_no")]
    pub ended_by_time: bool,
    /// Numbers of the groups whose lamps have a rank in common in each block, where the groups themselves do not tell: some were taken over
    /// from an earlier bake, which had more lamps or fewer beside them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub together: Option<Vec<u32>>,
    /// Truncation and sampling error of each column of lights: mean square over the square of its peak in the picture, 0 of a column that
    /// lights nothing. Known at the end of a bake; none where the halves did not tell.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub column_error: Vec<f32>,
    /// Matrices of irradiance, if they were asked for.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub irradiance: Vec<IrradianceHeader>,
    /// Patches that free lamps may light; their columns are the last of the basis.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub patches: Option<Patches>,
    /// Work that was left out.
    #[serde(default, skip_serializing_if = "Skips::is_all")]
    pub skips: Skips,
    /// What of it was found before the first sample.
    #[serde(default, skip_serializing_if = "Spared::is_nothing")]
    pub spared: Spared,
    /// What the columns rest on, so that a later bake can take them over; none of pictures, and of what a time ended.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub grounds: Option<Grounds>,
}

impl BakeHeader {
    /// Tiles of the picture.
    pub fn partition(&self) -> Partition {
        Partition { width: self.width, height: self.height, tile: self.tile }
    }

    /// Neighbors among pixels and among texels, for blocks that stay noisier than asked.
    pub(crate) fn smoothing(&self, partition: &Partition) -> Arc<Smoothing> {
        // Patches have walks and a compression of their own.
        let groups = self.basis.groups.iter().filter(|group| group.kind != ColumnKind::Patch);
        let runs = groups.map(|group| self.basis.runs(group)).collect();
        Arc::new(Smoothing::new(partition.clone(), CHANNELS, runs))
    }

    /// Which matrix of irradiance is that of the pixels, if it is one of the first `n_there`: those of a bake under way come last.
    pub fn pixel_irradiance(&self, n_there: usize) -> Option<usize> {
        self.irradiance.iter().take(n_there).position(|set| set.rows == IrradianceRows::Pixels)
    }

    /// Every sensor grid with the number of its matrix, if that is one of the first `n_there`.
    pub fn grids(&self, n_there: usize) -> impl Iterator<Item = (usize, &SensorGrid)> {
        self.irradiance.iter().take(n_there).enumerate().filter_map(|(set, header)| match &header.rows {
            IrradianceRows::Grid(grid) => Some((set, grid)),
            IrradianceRows::Pixels => None,
        })
    }

    /// No blocks yet, one matrix per group of columns.
    pub fn empty_groups(&self) -> Vec<BlockLowRank> {
        self.empty_matrices().swap_remove(0)
    }

    /// One RGB coefficient per column and group for a rig, as the factors of this bake take them.
    pub fn coefficients(&self, rig: &LightRig) -> Vec<Vec<[f32; 3]>> {
        self.scaled_coefficients(&self.column_scale, rig)
    }

    /// The same for a rig with free lamps, given the direct irradiance that they throw on a point of a patch, see
    /// [`Patches::coefficients`]. Without patches in the file nothing is asked.
    pub fn coefficients_with(
        &self,
        rig: &LightRig,
        irradiance: &(dyn Fn(&PatchSample) -> Vec3 + Sync),
    ) -> Vec<Vec<[f32; 3]>> {
        let mut coefficients = self.coefficients(rig);
        if let (Some(patches), Some(of_patches)) = (&self.patches, coefficients.last_mut()) {
            *of_patches = patches.coefficients(irradiance);
        }
        coefficients
    }

    /// Adds what free lamps throw on the patches, one RGB per column of these, to the coefficients of the picture or of a matrix
    /// of irradiance. Nothing without patches.
    pub fn add_of_patches(&self, coefficients: &mut [Vec<[f32; 3]>], of_patches: &[[f32; 3]]) {
        if let (Some(_), Some(last)) = (&self.patches, coefficients.last_mut()) {
            for (sum, more) in last.iter_mut().zip(of_patches) {
                (0..3).for_each(|c| sum[c] += more[c]);
            }
        }
    }

    pub(crate) fn scaled_coefficients(&self, column_scale: &[f32], rig: &LightRig) -> Vec<Vec<[f32; 3]>> {
        let mut coefficients = self.basis.project(rig);
        for (c, scale) in coefficients.iter_mut().zip(column_scale) {
            *c = c.map(|x| x / scale);
        }
        self.basis.split_by_group(&coefficients)
    }
}

/// Facts of a running bake.
#[derive(Clone, Debug)]
pub enum BakeEvent {
    /// The columns are known; blocks follow.
    Started {
        /// What is being baked.
        header: Arc<BakeHeader>,
        /// Blocks of each pass.
        n_blocks: usize,
        /// Passes, the preview included.
        n_passes: u32,
    },
    /// A block is there, coarse or final.
    BlockDone {
        /// Pass, 0 is the first.
        pass: u32,
        /// Block of the partition.
        block_idx: usize,
        /// One per group of columns.
        factors: Vec<Arc<BlockFactors>>,
    },
    /// A block of a matrix of irradiance is there: that of the pixels as a preview first, behind that of the picture, and last of
    /// all as it stays; those of grids once, before the picture is refined or at the end.
    IrradianceDone {
        /// Which matrix, in the order of the header.
        set: usize,
        /// Block of its partition.
        block_idx: usize,
        /// One per group of columns.
        factors: Vec<Arc<BlockFactors>>,
        /// Whether a finer one follows.
        is_preview: bool,
    },
    /// How far the whole bake is.
    Progress {
        /// Pass that runs; irradiance counts to the last one.
        pass: u32,
        /// 0…1 over all passes, each block counting by its samples.
        done: f32,
        /// Seconds left, once there is something to judge by: never while the preview runs.
        secs_left: Option<f32>,
    },
    /// Blocks that were told of, and those around them, have less noise now: these take their place in the picture.
    Denoised {
        /// Pass that they are of.
        pass: u32,
        /// Blocks of the partition, with one factor per group of columns, those of patches aside.
        blocks: Vec<(usize, Vec<Arc<BlockFactors>>)>,
    },
    /// Irradiance of pixels that was told of, as a preview or as it stays, has less noise now: these blocks take the place of its
    /// own.
    IrradianceDenoised {
        /// Which matrix, in the order of the header.
        set: usize,
        /// Blocks of its partition, with one factor per group of columns, those of patches aside.
        blocks: Vec<(usize, Vec<Arc<BlockFactors>>)>,
    },
    /// Every block of a pass is there.
    PassDone {
        /// Pass that ended.
        pass: u32,
        /// Error as its blocks tell it.
        error_db: ErrorDb,
    },
}

/// A finished bake.
#[derive(Clone, Debug)]
pub struct Bake {
    /// What it is of.
    pub header: Arc<BakeHeader>,
    /// One matrix per group of columns.
    pub groups: Vec<BlockLowRank>,
    /// For each matrix of irradiance in the header, one part per group of columns.
    pub irradiance: Vec<Vec<BlockLowRank>>,
    /// The same factors as a file holds them, if they come from there or are to go there: all matrices, the picture first.
    pub packed: Option<Arc<PackedMatrices>>,
}

/// For each matrix one part per group of columns.
pub type PackedMatrices = Vec<Vec<PackedMatrix>>;

/// What is there of a bake that was stopped in its last pass.
#[derive(Clone, Debug)]
pub struct HalfDone {
    /// What it is of.
    pub header: Arc<BakeHeader>,
    /// Blocks of the last pass, numbered through all matrices, one factor per group of columns.
    pub blocks: Vec<(usize, Vec<Arc<BlockFactors>>)>,
}

impl BakeEvent {
    /// The event of a block; matrix 0 is the picture.
    fn of_block(pass: u32, (matrix, block_idx): (usize, usize), factors: Vec<Arc<BlockFactors>>) -> BakeEvent {
        match matrix {
            0 => BakeEvent::BlockDone { pass, block_idx, factors },
            _ => BakeEvent::IrradianceDone { set: matrix - 1, block_idx, factors, is_preview: false },
        }
    }
}

impl BakeJob {
    /// Bakes. `on_event` may ask to stop; then the result is `None`.
    ///
    /// # Errors
    /// See [`BakeError`].
    pub fn run(self, on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send) -> Result<Option<Bake>, BakeError> {
        self.run_toward(&Focus::default(), None, on_event)
    }

    /// The same for somebody who looks at it: blocks where `focus` is come first, and what was done of the same job before is
    /// taken as it is. The result is the same to the last byte.
    ///
    /// # Errors
    /// See [`BakeError`].
    pub fn run_toward(
        self,
        focus: &Focus,
        begun: Option<HalfDone>,
        on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
    ) -> Result<Option<Bake>, BakeError> {
        // Blocks that have other columns are of no use: they took some over from a bake that is gone.
        let own = &self.scene.lighting.basis;
        let begun = begun.filter(|begun| begun.header.basis.has_lights_of(own));
        let HalfDone { header, blocks } = match begun {
            Some(begun) => begun,
            None => match self.header_toward(focus)? {
                Some(header) => HalfDone { header: Arc::new(header), blocks: Vec::new() },
                None => return Ok(None),
            },
        };
        self.run_from(header, &blocks, focus, on_event)
    }

    /// Whether the camera is none of the scene's.
    fn is_own_view(&self) -> bool {
        !self.scene.scene.cameras.contains(&self.camera)
    }

    /// Checks the job and measures the columns' scale.
    ///
    /// # Errors
    /// See [`BakeError`].
    pub fn header(&self) -> Result<BakeHeader, BakeError> {
        Ok(self.header_toward(&Focus::default())?.expect("nobody else knows of this focus, so nobody leaves"))
    }

    /// The same for somebody who may leave: then there is none.
    fn header_toward(&self, focus: &Focus) -> Result<Option<BakeHeader>, BakeError> {
        self.check()?;
        let (empty, dark) = (self.empty_pixels(), dark_sources(&self.scene, self.camera.position()));
        let plan = MatrixPlan::without(&self.scene.lighting, Density::Full, &dark);
        let (column_scale, sky_reach) = self.matrix(&plan, empty.clone(), focus).measure_columns();
        let mut header = BakeHeader {
            scene: self.scene.scene.name.clone(),
            fingerprint: fingerprint(&self.scene.scene, &self.camera),
            camera: self.camera.name.clone(),
            view: (self.scene.lighting.basis.sky.is_some() || self.is_own_view()).then(|| self.camera.clone()),
            width: self.film.width,
            height: self.film.height,
            tile: self.config.block,
            config: self.config.clone(),
            basis: self.scene.lighting.basis.clone(),
            column_scale,
            sky_reach,
            sharing_bias: None,
            preview_blocks: 0,
            ended_by_time: false,
            together: None,
            column_error: Vec::new(),
            irradiance: self.irradiance_headers(&dark, focus)?,
            patches: None,
            skips: self.scene.skips,
            spared: self.scene.spared(),
            grounds: Some(self.grounds()),
        };
        header.spared.empty_pixels = empty.as_ref().map_or(0, |empty| empty.count());
        header.spared.dark_sources = dark;
        if self.scene.skips.has(Skip::WeakLight) {
            let plan = self.plan(Density::Full, &header);
            let mut matrix = self.matrix(&plan, empty, focus);
            matrix.set_column_scale(self.own_scale(&header.column_scale));
            header.spared.weak_connections = matrix.weak_connections();
        }
        self.add_patches(&mut header, focus);
        Ok((!focus.is_left()).then_some(header))
    }

    /// Pixels that see nothing, if there are any and they may be left out.
    fn empty_pixels(&self) -> Option<Arc<EmptyPixels>> {
        let find = || EmptyPixels::find(&self.scene.scene.mesh, &self.camera, self.film);
        self.scene.skips.has(Skip::EmptyPixels).then(find).flatten().map(Arc::new)
    }

    fn plan(&self, density: Density, header: &BakeHeader) -> MatrixPlan {
        let plan = MatrixPlan::without(&self.scene.lighting, density, &header.spared.dark_sources);
        let plan = plan.fitted(&header.column_scale, &header.sky_reach, self.scene.skips);
        let plan = if self.scene.connects_to_all { plan } else { plan.with_lone_picks() };
        match self.config.indirect {
            Indirect::Shared => plan.for_short_walks(),
            Indirect::Traced => plan,
        }
    }

    fn matrix<'a>(
        &'a self,
        plan: &'a MatrixPlan,
        empty: Option<Arc<EmptyPixels>>,
        focus: &'a Focus,
    ) -> TransportMatrix<'a> {
        let BakeConfig { bounces, seed, .. } = self.config;
        let matrix = TransportMatrix::new(&self.scene, plan, self.camera.clone(), self.film, bounces, seed);
        let matrix = matrix.with_empty_pixels(empty).watched(focus);
        if self.passes == Passes::FirstLook { matrix.of_centers() } else { matrix }
    }

    /// The matrix of a bake, its columns scaled as its header says, and the pixels that see nothing.
    fn scaled_matrix<'a>(
        &'a self,
        plan: &'a MatrixPlan,
        header: &BakeHeader,
        focus: &'a Focus,
    ) -> (TransportMatrix<'a>, Option<Arc<EmptyPixels>>) {
        let empty = if header.spared.empty_pixels > 0 { self.empty_pixels() } else { None };
        let mut matrix = self.matrix(plan, empty.clone(), focus);
        matrix.set_column_scale(self.own_scale(&header.column_scale));
        (matrix, empty)
    }

    fn check(&self) -> Result<(), BakeError> {
        let (Film { width, height }, config) = (self.film, &self.config);
        if self.scene.scene.mesh.triangles.is_empty() {
            return Err(BakeError::NoTriangles);
        }
        if !(1..=Film::MAX_SIDE).contains(&width) || !(1..=Film::MAX_SIDE).contains(&height) {
            return Err(BakeError::Size { width, height });
        }
        let complain = |what: &str| Err(BakeError::Config { what: what.into() });
        if config.spp == 0 {
            return complain("a bake needs at least 1 sample per pixel");
        }
        check_block(config.block)?;
        check_tolerance(config.tolerance_db)?;
        if self.passes.deadline().is_some() && (config.patches > 0 || !self.irradiance.is_empty()) {
            return complain(
                "a bake within a time has neither patches for movable lamps nor irradiance; limit its samples",
            );
        }
        Ok(())
    }

    /// Bakes with a header that was made before; blocks of the last pass that are `done` already, numbered through
    /// all matrices, are taken as they are.
    pub(crate) fn run_from(
        self,
        header: Arc<BakeHeader>,
        done: &[(usize, Vec<Arc<BlockFactors>>)],
        focus: &Focus,
        mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
    ) -> Result<Option<Bake>, BakeError> {
        let plan = self.plan(Density::Full, &header);
        let (matrix, empty) = self.scaled_matrix(&plan, &header, focus);
        let partition = header.partition();
        let (passes, partitions) = (self.pass_samples(done.is_empty()), header.partitions());
        let n_blocks = partition.n_blocks();
        let last = passes.len() as u32 - 1;
        let mut run = Run::new(&self, &matrix, &header, (focus, empty), last);
        run.deadline = self.passes.deadline().map(|at| Deadline::new(at, u32::from(self.config.is_exact())));
        if on_event(BakeEvent::Started { header: header.clone(), n_blocks, n_passes: passes.len() as u32 }).is_break() {
            return Ok(None);
        }
        let mut n_given = vec![0; partitions.len()];
        for (number, factors) in done {
            let place = locate(&partitions, *number).expect("a block that was read has its place in the header");
            n_given[place.0] += 1;
            run.keep(place, factors);
            if on_event(BakeEvent::of_block(last, place, factors.clone())).is_break() {
                return Ok(None);
            }
        }
        let mut clock = Clock::new(&passes, n_blocks, n_given[0], rayon::current_num_threads());
        let of_irradiance = header.irradiance_passes(&passes, &n_given[1..], &mut clock);
        for (pass, &samples) in passes.iter().enumerate() {
            let mut blocks = from_the_center(&partition);
            if pass as u32 == last || run.deadline.is_some() || self.passes == Passes::Again {
                blocks.retain(|b| !done.iter().any(|(d, _)| *d == *b as usize));
            }
            if run.deadline.is_some() {
                run.noisy_first(&mut blocks);
            }
            let pass = pass as u32;
            let flow = run.pass(pass, samples, &blocks, &mut clock, &mut on_event)?;
            if flow.is_break() || run.end_pass(pass, &mut on_event).is_break() {
                if run.has_struck() {
                    break;
                }
                return Ok(None);
            }
            if pass != last && !run.foresees_its_end() {
                return Ok(None);
            }
            for own in of_irradiance.iter().filter(|own| own.follows == pass) {
                let blocks = run.missing(1 + own.set);
                if run.irradiance(own, &blocks, &mut clock, &mut on_event)?.is_break() {
                    return Ok(None);
                }
            }
        }
        let header = run.header_at_the_end(run.has_struck());
        Ok(run.into_matrices().and_then(|matrices| Bake::packing(header, matrices, focus)))
    }

    /// Samples per half of each pass; `None` is the preview.
    fn pass_samples(&self, from_scratch: bool) -> Vec<Option<u32>> {
        let all = self.config.samples_per_half();
        let growing = std::iter::successors(Some(FIRST_OF_GROWING), |n| n.checked_mul(4));
        match self.passes {
            Passes::Until(_) => {
                let growing = growing.take_while(|n| *n < all).map(Some);
                [None].into_iter().chain(growing).chain([Some(all)]).collect()
            }
            Passes::Again => vec![None, Some(all)],
            _ if !from_scratch => vec![Some(all)],
            Passes::Progressive if all >= 32 => vec![None, Some(all / 16), Some(all)],
            Passes::Progressive | Passes::FirstLook | Passes::PreviewAndFinal => vec![None, Some(all)],
            Passes::FinalOnly => vec![Some(all)],
        }
    }

    /// `column_scale` is that of the header: the light of the file comes out as it was sampled, whatever is truncated.
    fn compress_config(&self, samples_per_half: u32, tolerance_db: f32, column_scale: &[f32]) -> CompressConfig {
        let file_light = self.scene.lighting.basis.file_light(column_scale);
        let tolerance = mean_square(tolerance_db);
        let groups = self.scene.lighting.basis.groups.iter().map(|g| ColumnGroup {
            columns: g.columns.start as usize..g.columns.end as usize,
            tolerance: Tolerance::AbsoluteMeanSquare(tolerance),
            preserved: file_light[g.columns.start as usize..g.columns.end as usize].to_vec(),
            share: truncation_share(g.kind),
            apart: apart(g.kind),
        });
        let first_look = match self.config.indirect {
            Indirect::Shared => FIRST_LOOK_SHARED,
            Indirect::Traced => FIRST_LOOK_TRACED,
        };
        let looks = self.scene.skips.has(Skip::ConvergedBlocks);
        CompressConfig {
            groups: groups.collect(),
            samples: SamplePlan {
                batch: samples_per_half.min(8),
                min: if looks { samples_per_half.min(first_look) } else { samples_per_half },
                max: samples_per_half,
            },
            seed: self.config.seed,
            method: self.config.method,
            max_rank: self.config.max_rank(),
            strong: BRIGHT,
            ..CompressConfig::default()
        }
    }
}

/// Columns of a group up to which a pass over so many pixels keeps it as it was sampled, at most so many.
fn n_lamps_apart(basis: &LightBasis, n_pixels: usize, most: usize) -> usize {
    // A number and its doubt, 16 bits each.
    let column_bytes = 4 * CHANNELS * n_pixels;
    let groups = || basis.groups.iter().filter(|group| apart(group.kind) > 0.0);
    let lens = || groups().map(|group| group.columns.len());
    let all_bytes = |most: usize| column_bytes * lens().filter(|len| *len <= most).sum::<usize>();
    let fits = |most: &usize| all_bytes(*most) <= LAMPS_APART_BYTES;
    (0..=most).rev().find(fits).unwrap_or(0)
}

impl BakeHeader {
    /// Lamps that have a rank in common in each block of the picture, as they are too many to be kept apart, or as nothing takes out noise:
    /// what is weak or unsure of one alone may be left out there. 0 where there are none, and by other methods.
    pub(crate) fn n_lamps_together(&self) -> usize {
        let n_lamps = |group: u32| self.basis.groups.get(group as usize).map_or(0, |group| group.columns.len());
        self.groups_together().into_iter().map(n_lamps).sum()
    }

    /// Numbers of the groups that these are.
    pub(crate) fn groups_together(&self) -> Vec<u32> {
        if let Some(together) = &self.together {
            return together.clone();
        }
        if self.basis.is_measured() || self.config.method != Method::default() {
            return Vec::new();
        }
        let n_pixels = self.width as usize * self.height as usize;
        let most = if self.config.denoise { n_lamps_apart(&self.basis, n_pixels, LAMPS_APART) } else { 0 };
        let groups = (0u32..).zip(&self.basis.groups);
        let together = groups.filter(|(_, group)| apart(group.kind) > 0.0 && group.columns.len() > most.max(1));
        together.map(|(number, _)| number).collect()
    }
}

/// Whether a tolerance makes sense.
fn check_tolerance(tolerance_db: f32) -> Result<(), BakeError> {
    if (0.0..=120.0).contains(&tolerance_db) {
        return Ok(());
    }
    Err(BakeError::Config { what: "the tolerance must be between 0 and 120 dB".into() })
}

/// Whether blocks may have a side.
fn check_block(side: u32) -> Result<(), BakeError> {
    if SIDES.contains(&side) {
        return Ok(());
    }
    Err(BakeError::Config { what: format!("blocks have 8, 16 or 32 pixels to a side, not {side}") })
}

/// Mean square error of a tolerance, the peak of a column being 1.
fn mean_square(tolerance_db: f32) -> f32 {
    10f32.powf(-tolerance_db / 10.0)
}

/// Share of the tolerance that truncation and packing may take of columns of a kind. A sun that is moved puts all of its light into one
/// patch of the sky, and most patches hold nothing in most blocks: their mean error hides that of the one.
fn truncation_share(kind: ColumnKind) -> f32 {
    if kind == ColumnKind::Sky { SKY_SHARE } else { 1.0 }
}

/// 7 dB.
const SKY_SHARE: f32 = 0.2;

/// Root mean square from which on the tolerance of a column of a kind is taken as it is, the peak of the column being 1: lamps are
/// soloed, dimmed and looked at one by one, so that each is held to what it throws in a block.
fn apart(kind: ColumnKind) -> f32 {
    if kind == ColumnKind::Luminaire { 0.5 } else { 0.0 }
}

/// Blocks from the middle of the picture outwards, where people look first.
fn from_the_center(partition: &Partition) -> Vec<u32> {
    let mut blocks: Vec<u32> = (0..partition.n_blocks() as u32).collect();
    let (cx, cy) = (i64::from(partition.tiles_x()) - 1, i64::from(partition.tiles_y()) - 1);
    blocks.sort_by_key(|&b| {
        let (x, y) = (i64::from(b % partition.tiles_x()), i64::from(b / partition.tiles_x()));
        (2 * x - cx).pow(2) + (2 * y - cy).pow(2)
    });
    blocks
}

/// A bake under way.
struct Run<'a> {
    job: &'a BakeJob,
    matrix: &'a TransportMatrix<'a>,
    header: &'a Arc<BakeHeader>,
    /// Which blocks come first.
    focus: &'a Focus,
    empty: Option<Arc<EmptyPixels>>,
    /// Of the picture, then of each matrix of irradiance.
    matrices: Vec<Vec<BlockLowRank>>,
    /// What pixels show, once it was looked at.
    guides: Option<Arc<Guides>>,
    /// The groups of the picture with less noise, where the last pass that ran has all of its blocks.
    denoised: Option<Vec<BlockLowRank>>,
    /// Light that the pixels of the pass before share, where rows of irradiance share it as well.
    nodes: Option<Nodes>,
    /// Memory of the light that pixels shared in any pass so far, at most, bytes.
    shared_bytes: u64,
    /// The last pass.
    last: u32,
    /// See [`BakeHeader::sharing_bias`]: of the pass that every block has.
    bias: Option<f32>,
    /// The same of each matrix of irradiance.
    irradiance_bias: Vec<Option<f32>>,
    started: Instant,
    deadline: Option<Deadline>,
}

/// When a bake has to end, if there is a whole picture.
struct Deadline {
    begun: Instant,
    at: Instant,
    /// The last pass that is never cut short: 0, the preview, or 1, the first that traces what it ends with.
    whole: u32,
    /// Blocks of the picture that the preview alone has come to.
    n_of_preview: u32,
    /// What will be done once it has struck takes about so long.
    ending: Duration,
    /// It came and ended a pass.
    has_struck: bool,
}

impl Deadline {
    fn new(at: Instant, whole: u32) -> Deadline {
        Deadline { begun: Instant::now(), at, whole, n_of_preview: 0, ending: Duration::ZERO, has_struck: false }
    }

    /// A block of the picture came. The preview goes over all that the next pass does.
    fn count(&mut self, pass: u32) {
        match pass {
            0 => self.n_of_preview += 1,
            1 => self.n_of_preview -= 1,
            _ => {}
        }
    }

    /// Breaks once it has come, but for passes that are never cut short.
    fn strike(&mut self, pass: u32) -> ControlFlow<()> {
        if pass > self.whole && self.left() <= self.ending {
            self.has_struck = true;
            return ControlFlow::Break(());
        }
        ControlFlow::Continue(())
    }

    fn left(&self) -> Duration {
        self.at.saturating_duration_since(Instant::now())
    }

    /// 0…1, and seconds left.
    fn progress(&self) -> (f32, f32) {
        let left = self.left().as_secs_f32();
        let all = self.at.saturating_duration_since(self.begun).as_secs_f32();
        ((1.0 - left / all.max(f32::MIN_POSITIVE)).clamp(0.0, 1.0), left)
    }
}

impl<'a> Run<'a> {
    /// With no blocks yet.
    fn new(
        job: &'a BakeJob,
        matrix: &'a TransportMatrix<'a>,
        header: &'a Arc<BakeHeader>,
        (focus, empty): (&'a Focus, Option<Arc<EmptyPixels>>),
        last: u32,
    ) -> Run<'a> {
        Run {
            job,
            matrix,
            header,
            focus,
            empty,
            matrices: header.empty_matrices(),
            guides: None,
            denoised: None,
            nodes: None,
            shared_bytes: 0,
            last,
            bias: header.sharing_bias,
            irradiance_bias: header.irradiance.iter().map(|set| set.sharing_bias).collect(),
            started: Instant::now(),
            deadline: None,
        }
    }
}

impl Run<'_> {
    /// Blocks of a matrix that are not there yet, from its middle outwards.
    fn missing(&self, matrix: usize) -> Vec<u32> {
        let mut blocks = from_the_center(&self.header.partitions()[matrix]);
        let groups = &self.matrices[matrix];
        blocks.retain(|&block| groups.iter().any(|group| group.blocks[block as usize].is_none()));
        blocks
    }

    /// Whether a time that was up has ended the bake.
    fn has_struck(&self) -> bool {
        self.deadline.as_ref().is_some_and(|deadline| deadline.has_struck)
    }

    /// What the bake is of, once all is known about it.
    fn header_at_the_end(&self, has_struck: bool) -> Arc<BakeHeader> {
        let biases = || self.irradiance_bias.iter().chain([&self.bias]);
        if !has_struck && biases().all(Option::is_none) {
            return self.header.clone();
        }
        let preview_blocks = self.deadline.as_ref().map_or(0, |deadline| deadline.n_of_preview);
        let mut header = BakeHeader {
            sharing_bias: self.bias,
            preview_blocks,
            ended_by_time: has_struck,
            ..(**self.header).clone()
        };
        for (set, bias) in header.irradiance.iter_mut().zip(&self.irradiance_bias) {
            set.sharing_bias = *bias;
        }
        // What a time ended is nothing that a later bake could build on.
        header.grounds.take_if(|_| has_struck);
        Arc::new(header)
    }

    fn keep(&mut self, (matrix, block_idx): (usize, usize), factors: &[Arc<BlockFactors>]) {
        for (group, factors) in self.matrices[matrix].iter_mut().zip(factors) {
            group.blocks[block_idx] = Some(factors.clone());
        }
    }

    /// Keeps a block and tells of it.
    fn deliver(
        &mut self,
        place: (usize, usize),
        pass: u32,
        factors: Vec<Arc<BlockFactors>>,
        clock: &mut Clock,
        on_event: &mut impl FnMut(BakeEvent) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        self.keep(place, &factors);
        let (mut done, mut secs_left) = clock.block_done(self.started.elapsed().as_secs_f32());
        on_event(BakeEvent::of_block(pass, place, factors))?;
        if let Some(deadline) = &mut self.deadline {
            deadline.count(pass);
            let (share, left) = deadline.progress();
            done = done.max(share);
            // Passes that are made whatever the time is do not end by it.
            let left = (pass > deadline.whole).then_some(left);
            secs_left = left.map(|left| secs_left.map_or(left, |secs| secs.min(left)));
            deadline.strike(pass)?;
        }
        on_event(BakeEvent::Progress { pass, done, secs_left })
    }

    /// How the blocks of a pass over a matrix are compressed.
    fn compression(
        &self,
        (samples, is_last): (Option<u32>, bool),
        column_scale: &[f32],
        partition: &Partition,
    ) -> CompressConfig {
        let job = self.job;
        let tolerance_db = job.config.tolerance_of(samples);
        let mut config = job.compress_config(samples.unwrap_or(1), tolerance_db, column_scale);
        if is_last {
            config.smoothing = job.config.smooth.then(|| self.header.smoothing(partition));
        } else {
            config.method = Method::default();
        }
        config
    }

    fn pass(
        &mut self,
        pass: u32,
        samples: Option<u32>,
        blocks: &[u32],
        clock: &mut Clock,
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send),
    ) -> Result<ControlFlow<()>, BakeError> {
        let (job, header) = (self.job, self.header.clone());
        (self.denoised, self.nodes) = (None, None);
        let (partition, started, focus) = (header.partition(), self.started, self.focus);
        // The preview connects to fewer texels and sends no walks to mirrors and glass; the rest is the same.
        let (coarse_plan, mut coarse);
        let matrix = match samples {
            Some(_) => self.matrix,
            None => {
                coarse_plan = job.plan(Density::Quarter, &header);
                coarse = job.matrix(&coarse_plan, self.empty.clone(), focus).unguided();
                coarse.set_column_scale(job.own_scale(&header.column_scale));
                &coarse
            }
        };
        // Until the last pass the picture is there to be looked at: its light is always shared. Before a deadline any pass with
        // samples may be the last.
        let is_last = pass == self.last || (samples.is_some() && self.deadline.is_some());
        let indirect = if is_last { job.config.indirect } else { Indirect::Shared };
        let shared = match indirect.nodes(samples, job.config.tolerance_db) {
            None => None,
            Some(plan) => {
                let deadline = &mut self.deadline;
                let go_on = || {
                    deadline.iter_mut().try_for_each(|deadline| deadline.strike(pass))?;
                    on_event(BakeEvent::Progress { pass, done: clock.done(), secs_left: None })
                };
                let Some(nodes) = Nodes::gather(matrix, plan, go_on) else { return Ok(ControlFlow::Break(())) };
                self.shared_bytes = self.shared_bytes.max(nodes.n_bytes() as u64);
                Some(SharedMatrix { matrix, nodes })
            }
        };
        let mut config = self.compression((samples, is_last), &header.column_scale, &partition);
        config.verbatim = self.n_lamps_apart(pass, samples.is_none());
        let mut of_patches = PatchBlocks::none(&header);
        if is_last && self.patches(&mut of_patches, (0, blocks), (pass, clock.done()), on_event)?.is_break() {
            return Ok(ControlFlow::Break(()));
        }
        let is_kept = is_last || self.deadline.is_some();
        let bias = shared.as_ref().filter(|_| is_kept).map(|shared| shared.bias(job.config.tolerance_db));
        let likenesses = if self.is_denoised(pass == self.last) {
            let Some(likenesses) = self.likenesses() else { return Ok(ControlFlow::Break(())) };
            Some(likenesses)
        } else {
            None
        };
        let own = &self.matrices[0][..self.n_own()];
        let arrivals = likenesses.as_ref().map(|likenesses| likenesses.arrivals(job, own, blocks));
        clock.start_pass(pass as usize, started.elapsed().as_secs_f32());
        let on_block = |block: u32, mut factors: Vec<BlockFactors>| {
            factors.extend(of_patches.take(block));
            let factors: Vec<_> = factors.into_iter().map(Arc::new).collect();
            let blocks = arrivals.as_ref().map_or_else(Vec::new, |arrivals| {
                arrivals.came(block as usize, &factors);
                arrivals.take_ready()
            });
            self.deliver((0, block as usize), pass, factors, clock, on_event)?;
            denoise::tell(focus, pass, blocks, on_event)
        };
        let guide = Guide {
            order: &|left| focus.next(&partition, left),
            goes_on: &|| !focus.is_left(),
            delivered: &|block| arrivals.iter().for_each(|arrivals| arrivals.denoise_around(block as usize)),
        };
        let flow = match &shared {
            Some(shared) => compress_by(guide, shared, &partition, blocks, &config, on_block)?,
            None => compress_by(guide, matrix, &partition, blocks, &config, on_block)?,
        };
        if flow.is_break() {
            if let Some(arrivals) = arrivals.filter(|_| self.has_struck()) {
                // Blocks that came have less noise already.
                self.denoised = arrivals.finish(&|| !focus.is_left()).map(|(_, denoised)| denoised);
            }
            return Ok(flow);
        }
        self.bias = bias;
        self.nodes = shared.map(|shared| shared.nodes).filter(|_| header.pixel_irradiance(usize::MAX).is_some());
        if let Some(arrivals) = arrivals {
            let finished = arrivals.finish(&|| !focus.is_left());
            let Some((blocks, denoised)) = finished else { return Ok(ControlFlow::Break(())) };
            self.denoised = Some(denoised);
            return Ok(denoise::tell(focus, pass, blocks, on_event));
        }
        Ok(flow)
    }
}
