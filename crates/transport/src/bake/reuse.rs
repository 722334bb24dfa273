//! A bake again: columns whose light can have changed in nothing are taken over from an earlier bake, the others are traced.
//!
//! Columns come in groups, each with factors of its own. So what is taken over stays as it is, byte for byte, and what is
//! traced is a bake of the new lights alone, whose groups come behind. Lights that are gone leave their group, which is then
//! packed again. Rows of irradiance are matrices of their own: those that are new are traced beside a picture that stays.

use std::ops::ControlFlow;
use std::sync::Arc;

use clerestory_nystrom::{BlockFactors, BlockLowRank, PackPlan, PackedMatrix};
use thiserror::Error;

use super::focus::Focus;
use super::grounds::{Grounds, serves};
use super::{Bake, BakeConfig, BakeError, BakeEvent, BakeHeader, BakeJob, HalfDone};
use crate::basis::{ColumnGroup, ColumnKind, LightBasis, LightSource};
use crate::fingerprint::fingerprint;
use crate::irradiance::{IrradianceHeader, IrradianceRows};
use crate::skips::{Skip, Spared};

/// Why nothing of an earlier bake is of use.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[non_exhaustive]
pub enum NothingKept {
    /// It was asked for.
    #[error("every column is to be traced")]
    Off,
    /// It is not whole, of pictures, of another program, or was ended by a time.
    #[error("it does not tell what its columns rest on")]
    Unknown,
    /// Its settings are others.
    #[error("its settings, or the version of the program, are others")]
    Settings,
    /// Camera or size are others.
    #[error("the camera or the size of the picture is another one")]
    View,
    /// Surfaces have changed, and every column sees them all.
    #[error("surfaces or materials have changed, and the light of every column meets them")]
    Surfaces,
    /// No light is the same.
    #[error("none of its lights is the same")]
    Lights,
    /// It lacks rows of irradiance, and its columns are others as well.
    #[error("it lacks rows of irradiance, and its lights are others as well")]
    Irradiance,
}

/// What of an earlier bake a job takes over.
pub struct Reuse {
    earlier: Bake,
    parts: Vec<Part>,
    /// For each matrix of irradiance of the job the one of the earlier bake with the same rows.
    sets: Vec<Option<usize>>,
    /// Factors of each matrix of the job and part; none of a matrix that the earlier bake lacks.
    kept: Vec<Vec<BlockLowRank>>,
    /// Sources of the job that are traced, by their index there.
    fresh: Vec<usize>,
    /// The columns of the job, in the order of its scene.
    basis: LightBasis,
    /// What the job's own columns rest on, in that order.
    lights: Vec<String>,
    /// The header but for what the new columns add to it.
    header: BakeHeader,
}

/// What is taken over of a group of columns.
struct Part {
    /// Its number in the earlier bake.
    group: usize,
    /// Columns within the group.
    columns: Vec<u32>,
    /// Whether that is all of them.
    is_whole: bool,
    /// Its sources in the earlier bake and in the job.
    sources: Vec<(usize, usize)>,
}

impl BakeJob {
    /// What it can take over from an earlier bake.
    ///
    /// # Errors
    /// [`NothingKept`].
    pub fn reuse(&self, earlier: &Bake) -> Result<Reuse, NothingKept> {
        if !self.scene.skips.has(Skip::Reuse) {
            return Err(NothingKept::Off);
        }
        let there = earlier.header.grounds.as_ref().filter(|_| earlier.packed.is_some()).ok_or(NothingKept::Unknown)?;
        let wanted = self.grounds();
        for (is_other, why) in [
            (there.settings != wanted.settings, NothingKept::Settings),
            (!self.has_view_of(&earlier.header, there), NothingKept::View),
            (!self.has_surfaces_of(there, &wanted), NothingKept::Surfaces),
        ] {
            if is_other {
                return Err(why);
            }
        }
        let basis = self.scene.lighting.basis.clone();
        let pairs = pairs((&earlier.header.basis.sources, &there.lights), (&basis.sources, &wanted.lights));
        if pairs.is_empty() {
            return Err(NothingKept::Lights);
        }
        let parts = parts(&earlier.header.basis, &pairs);
        let fresh: Vec<usize> =
            (0..basis.sources.len()).filter(|new| pairs.iter().all(|(_, kept)| kept != new)).collect();
        let same_rows = |rows: &IrradianceRows| earlier.header.irradiance.iter().position(|set| set.rows == *rows);
        let sets: Vec<Option<usize>> = self.irradiance.iter().map(same_rows).collect();
        let has_same_lights = fresh.is_empty() && pairs.len() == earlier.header.basis.sources.len();
        if sets.contains(&None) && !has_same_lights {
            return Err(NothingKept::Irradiance);
        }
        let of_sets = sets.iter().map(|set| set.map(|set| &earlier.irradiance[set]));
        let matrices = std::iter::once(Some(&earlier.groups)).chain(of_sets);
        let take = |groups: Option<&Vec<BlockLowRank>>| {
            let of_part = |part: &Part| {
                let group = &groups?[part.group];
                Some(if part.is_whole { group.clone() } else { group.with_columns(&part.columns) })
            };
            parts.iter().filter_map(of_part).collect()
        };
        let kept = matrices.map(take).collect();
        let shows_more = basis.sky.is_some() || self.is_own_view() || earlier.header.patches.is_some();
        let n_cols = earlier.header.basis.n_cols();
        let header = BakeHeader {
            scene: self.scene.scene.name.clone(),
            fingerprint: fingerprint(&self.scene.scene, &self.camera),
            camera: self.camera.name.clone(),
            view: shows_more.then(|| self.camera.clone()),
            skips: self.scene.skips,
            grounds: Some(Grounds { lights: Vec::new(), ..wanted.clone() }),
            irradiance: self.irradiance.iter().map(|rows| IrradianceHeader::unmeasured(rows.clone(), n_cols)).collect(),
            ..(*earlier.header).clone()
        };
        Ok(Reuse { earlier: earlier.clone(), parts, sets, kept, fresh, basis, lights: wanted.lights, header })
    }

    /// Bakes what is new and takes over the rest. The events are those of the whole; `begun` as in [`BakeJob::run_toward`].
    ///
    /// # Errors
    /// See [`BakeError`].
    pub fn run_reusing(
        self,
        reuse: &Reuse,
        focus: &Focus,
        begun: Option<HalfDone>,
        mut on_event: impl FnMut(BakeEvent) -> ControlFlow<()> + Send,
    ) -> Result<Option<Bake>, BakeError> {
        self.check()?;
        let n_blocks = reuse.header.partition().n_blocks();
        if reuse.n_added_rows() > 0 {
            let job = reuse.regrouped(self);
            let header = Arc::new(reuse.header_with_rows(&job, focus)?);
            // Who left has measured nothing.
            if focus.is_left() {
                return Ok(None);
            }
            let done = begun.filter(|begun| begun.header == header).map_or_else(Vec::new, |begun| begun.blocks);
            return job.run_rows(reuse, &header, &done, focus, &mut on_event);
        }
        let Some(job) = reuse.rest_of(self) else {
            let bake = reuse.join(None);
            let flow = on_event(BakeEvent::Started { header: bake.header.clone(), n_blocks, n_passes: 1 });
            return Ok(flow.is_continue().then_some(bake));
        };
        let Some(of_new) = job.header_toward(focus)?.map(Arc::new) else { return Ok(None) };
        let header = Arc::new(reuse.header_with(Some(&of_new)));
        // A bake that took over other columns, or none, measured those that are new now beside others.
        let new_columns = reuse.n_kept_columns()..reuse.n_kept_columns() + of_new.basis.n_cols();
        let is_in_scale =
            |begun: &HalfDone| begun.header.column_scale.get(new_columns.clone()) == Some(&of_new.column_scale[..]);
        let begun = begun
            .filter(|begun| begun.header.basis.is_alike(&header.basis) && is_in_scale(begun))
            .map_or_else(Vec::new, |begun| begun.blocks);
        let n_kept = reuse.parts.len();
        let of_new_alone = |(number, factors): (usize, Vec<Arc<BlockFactors>>)| {
            (number, factors[n_kept..n_kept + of_new.basis.groups.len()].to_vec())
        };
        // Rows of irradiance have other groups.
        let done: Vec<_> = begun.into_iter().filter(|(number, _)| *number < n_blocks).map(of_new_alone).collect();
        let bake = job.run_from(of_new.clone(), &done, focus, |event| on_event(reuse.whole(event, &header)))?;
        Ok(bake.map(|new| reuse.join(Some(new))))
    }

    /// Bakes the rows of irradiance that the earlier bake lacks, given [`Reuse::header_with_rows`]; all columns stay as they are. The job
    /// is [regrouped](Reuse::regrouped).
    pub(crate) fn run_rows(
        &self,
        reuse: &Reuse,
        header: &Arc<BakeHeader>,
        done: &[(usize, Vec<Arc<BlockFactors>>)],
        focus: &Focus,
        on_event: &mut (impl FnMut(BakeEvent) -> ControlFlow<()> + Send),
    ) -> Result<Option<Bake>, BakeError> {
        let Bake { groups, irradiance, packed, .. } = reuse.join(None);
        let is_new = |set: usize| reuse.sets[set].is_none();
        let mut there = header.empty_matrices();
        there[0] = groups;
        for (set, groups) in irradiance.into_iter().enumerate().filter(|(set, _)| !is_new(*set)) {
            there[1 + set] = groups;
        }
        let Some((mut header, mut matrices)) = self.run_irradiance(header, there, done, focus, on_event)? else {
            return Ok(None);
        };
        let plans = header.pack_plans();
        let mut packed = Arc::unwrap_or_clone(packed.expect("a bake that was joined is packed"));
        for set in (0..reuse.sets.len()).filter(|set| is_new(*set)) {
            let matrix = 1 + set;
            let before = header.before_packing(&matrices[matrix]);
            let pack = |(group, plan): (&BlockLowRank, &PackPlan)| PackedMatrix::pack(group, plan);
            packed[matrix] = matrices[matrix].iter().zip(&plans[matrix]).map(pack).collect();
            let unpack = |group: &PackedMatrix| group.unpack().expect("what was just packed can be unpacked");
            matrices[matrix] = packed[matrix].iter().map(unpack).collect();
            if let Some(before) = before {
                Arc::make_mut(&mut header).tell_column_error(matrix, before, &matrices[matrix]);
            }
        }
        let groups = matrices.remove(0);
        Ok(Some(Bake { header, groups, irradiance: matrices, packed: Some(Arc::new(packed)) }))
    }
}

impl Reuse {
    /// Columns that are taken over.
    pub fn n_kept_columns(&self) -> usize {
        self.parts.iter().map(|part| part.columns.len()).sum()
    }

    /// Columns that are traced.
    pub fn n_traced_columns(&self) -> usize {
        self.fresh.iter().map(|&source| self.basis.sources[source].columns.len()).sum()
    }

    /// Matrices of irradiance that are traced for all columns.
    pub fn n_added_rows(&self) -> usize {
        self.sets.iter().filter(|set| set.is_none()).count()
    }

    /// Whether a matrix of irradiance is traced for all columns.
    pub(crate) fn adds(&self, set: usize) -> bool {
        self.sets[set].is_none()
    }

    /// Bytes of what is taken over: of its factors in memory, and packed, about.
    pub(crate) fn kept_bytes(&self) -> [u64; 2] {
        let packed = self.earlier.packed.as_deref();
        let mut bytes = [0; 2];
        for (matrix, kept) in self.kept.iter().enumerate() {
            let Some(there) = self.earlier_matrix(matrix).and_then(|there| packed?.get(there)) else { continue };
            let of_patches = self.patches(matrix);
            bytes[0] += kept.iter().chain(of_patches).map(|group| group.n_bytes() as u64).sum::<u64>();
            let of_part = |part: &Part| {
                let all = self.earlier.header.basis.groups[part.group].columns.len();
                there[part.group].n_bytes() as u64 * part.columns.len() as u64 / all.max(1) as u64
            };
            bytes[1] += self.parts.iter().map(of_part).sum::<u64>();
            bytes[1] += there.last().filter(|_| of_patches.is_some()).map_or(0, |group| group.n_bytes() as u64);
        }
        bytes
    }

    /// The header of a bake of the job that adds rows of irradiance, whose columns are measured.
    pub(crate) fn header_with_rows(&self, job: &BakeJob, focus: &Focus) -> Result<BakeHeader, BakeError> {
        job.check()?;
        let mut header = self.header_with(None);
        job.check_sensors()?;
        let n_cols = header.basis.n_cols();
        for (set, _) in header.irradiance.iter_mut().zip(&self.sets).filter(|(_, there)| there.is_none()) {
            *set = job.irradiance_header(&set.rows, &header.spared.dark_sources, focus);
            // Patches are scaled already.
            set.column_scale.resize(n_cols, 1.0);
        }
        Ok(header)
    }

    /// The matrix of the earlier bake that one of the job's is, if that is there: 0 is the picture.
    fn earlier_matrix(&self, matrix: usize) -> Option<usize> {
        if matrix == 0 { Some(0) } else { self.sets[matrix - 1].map(|set| 1 + set) }
    }

    /// The job of a bake that adds rows of irradiance, its columns in the order and the groups that they have in the earlier one: lamps that
    /// were added to that, or moved in it, stand behind the others and have a group of their own.
    pub(crate) fn regrouped(&self, job: BakeJob) -> BakeJob {
        let mut basis = self.header_with(None).basis;
        basis.groups.retain(|group| group.kind != ColumnKind::Patch);
        if basis == job.scene.lighting.basis {
            return job;
        }
        let order: Vec<usize> = self.parts.iter().flat_map(|part| &part.sources).map(|&(_, of_job)| of_job).collect();
        let mut scene = Arc::unwrap_or_clone(job.scene);
        scene.lighting = scene.lighting.in_columns_of(basis, &order);
        BakeJob { scene: Arc::new(scene), ..job }
    }

    /// The bake of the new lights alone; `None` where there are none.
    pub(crate) fn rest_of(&self, job: BakeJob) -> Option<BakeJob> {
        if self.fresh.is_empty() {
            return None;
        }
        let mut scene = Arc::unwrap_or_clone(job.scene);
        scene.lighting = scene.lighting.only(&self.fresh);
        let config = BakeConfig { patches: 0, ..job.config };
        Some(BakeJob { scene: Arc::new(scene), config, ..job })
    }

    /// The whole, given the bake of [`Reuse::rest_of`].
    pub(crate) fn join(&self, new: Option<Bake>) -> Bake {
        let header = Arc::new(self.header_with(new.as_ref().map(|new| &*new.header)));
        let plans = header.pack_plans();
        let earlier = self.earlier.packed.as_ref().expect("only what is packed is taken over");
        let (mut matrices, mut packed) = (Vec::new(), Vec::new());
        for (matrix, kept) in self.kept.iter().enumerate() {
            let (mut groups, mut bytes) = (Vec::new(), Vec::new());
            let Some(there) = self.earlier_matrix(matrix) else {
                matrices.push(groups);
                packed.push(bytes);
                continue;
            };
            for ((part, group), plan) in self.parts.iter().zip(kept).zip(&plans[matrix]) {
                if part.is_whole {
                    groups.push(group.clone());
                    bytes.push(earlier[there][part.group].clone());
                } else {
                    let again = PackedMatrix::pack(group, plan);
                    groups.push(again.unpack().expect("what was just packed can be unpacked"));
                    bytes.push(again);
                }
            }
            if let Some(new) = &new {
                groups.extend_from_slice(if matrix == 0 { &new.groups } else { &new.irradiance[matrix - 1] });
                bytes.extend(new.packed.iter().flat_map(|new| new[matrix].iter().cloned()));
            }
            if header.patches.is_some() {
                groups.extend(self.patches(matrix).cloned());
                bytes.extend(earlier[there].last().cloned());
            }
            matrices.push(groups);
            packed.push(bytes);
        }
        let groups = matrices.remove(0);
        Bake { header, groups, irradiance: matrices, packed: Some(Arc::new(packed)) }
    }

    /// The columns of patches, if there are any: they rest on no light.
    fn patches(&self, matrix: usize) -> Option<&BlockLowRank> {
        let groups = match self.earlier_matrix(matrix)? {
            0 => &self.earlier.groups,
            there => &self.earlier.irradiance[there - 1],
        };
        groups.last().filter(|_| self.header.patches.is_some())
    }

    /// The event of the whole for one of the new columns.
    fn whole(&self, event: BakeEvent, header: &Arc<BakeHeader>) -> BakeEvent {
        let around = |matrix: usize, block_idx: usize, new: Vec<Arc<BlockFactors>>| {
            let kept = self.kept[matrix].iter().filter_map(|group| group.blocks[block_idx].clone());
            let of_patches = self.patches(matrix).and_then(|group| group.blocks[block_idx].clone());
            kept.chain(new).chain(of_patches).collect()
        };
        match event {
            BakeEvent::Started { n_blocks, n_passes, .. } => {
                BakeEvent::Started { header: header.clone(), n_blocks, n_passes }
            }
            BakeEvent::BlockDone { pass, block_idx, factors } => {
                BakeEvent::BlockDone { pass, block_idx, factors: around(0, block_idx, factors) }
            }
            BakeEvent::IrradianceDone { set, block_idx, factors, is_preview } => {
                let factors = around(1 + set, block_idx, factors);
                BakeEvent::IrradianceDone { set, block_idx, factors, is_preview }
            }
            BakeEvent::Denoised { pass, blocks } => {
                let blocks = blocks.into_iter().map(|(block_idx, new)| (block_idx, around(0, block_idx, new)));
                BakeEvent::Denoised { pass, blocks: blocks.collect() }
            }
            BakeEvent::IrradianceDenoised { set, blocks } => {
                let blocks = blocks.into_iter().map(|(block_idx, new)| (block_idx, around(1 + set, block_idx, new)));
                BakeEvent::IrradianceDenoised { set, blocks: blocks.collect() }
            }
            other => other,
        }
    }

    /// The header of the whole, given that of the new columns.
    fn header_with(&self, new: Option<&BakeHeader>) -> BakeHeader {
        let earlier = &self.earlier.header;
        // Sources of the whole: what they were in the earlier bake, and what they are in the job.
        let kept = self.parts.iter().flat_map(|part| &part.sources).map(|&(old, of_job)| (Some(old), of_job));
        // A bake of the new lights alone has them in the order of the job.
        let sources: Vec<(Option<usize>, usize)> =
            kept.chain(self.fresh.iter().map(|&of_job| (None, of_job))).collect();
        let mut header = BakeHeader { basis: self.joined_basis(&sources, new), together: None, ..self.header.clone() };
        header.together = self.joined_together(&header, new);
        let of_lights = |old: &[f32], new: Option<&[f32]>| -> Vec<f32> {
            let starts = self.parts.iter().map(|part| earlier.basis.groups[part.group].columns.start);
            let columns = self.parts.iter().zip(starts);
            let kept =
                columns.flat_map(|(part, start)| part.columns.iter().map(move |column| old[(start + column) as usize]));
            kept.chain(new.into_iter().flatten().copied()).collect()
        };
        let n_patches = header.patches.as_ref().map_or(0, |patches| patches.n_columns());
        let gather = |old: &[f32], new: Option<&[f32]>| -> Vec<f32> {
            let mut all = of_lights(old, new);
            all.extend_from_slice(&old[old.len() - n_patches..]);
            all
        };
        header.column_scale = gather(&earlier.column_scale, new.map(|new| &new.column_scale[..]));
        let has_old_sky = self.parts.iter().any(|part| earlier.basis.groups[part.group].kind == ColumnKind::Sky);
        let reach = |old: &Vec<f32>, new: Option<&Vec<f32>>| match new {
            _ if has_old_sky => old.clone(),
            Some(new) => new.clone(),
            None => Vec::new(),
        };
        header.sky_reach = reach(&earlier.sky_reach, new.map(|new| &new.sky_reach));
        let sets = self.sets.iter().enumerate().filter_map(|(set, there)| Some((set, &earlier.irradiance[(*there)?])));
        for (set, old) in sets {
            let of_new = new.map(|new| &new.irradiance[set]);
            header.irradiance[set].column_scale = gather(&old.column_scale, of_new.map(|new| &new.column_scale[..]));
            header.irradiance[set].sky_reach = reach(&old.sky_reach, of_new.map(|new| &new.sky_reach));
            let is_told = |set: &IrradianceHeader| !set.column_error.is_empty();
            let told = Some(old).filter(|old| is_told(old) && of_new.is_none_or(is_told));
            header.irradiance[set].column_error = told
                .map_or_else(Vec::new, |told| of_lights(&told.column_error, of_new.map(|new| &new.column_error[..])));
            let of_new = of_new.and_then(|new| new.sharing_bias);
            header.irradiance[set].sharing_bias = self.joined_bias(old.sharing_bias, of_new);
        }
        let is_told = |header: &BakeHeader| !header.column_error.is_empty();
        let told = Some(earlier).filter(|earlier| is_told(earlier) && new.is_none_or(is_told));
        header.column_error =
            told.map_or_else(Vec::new, |told| of_lights(&told.column_error, new.map(|new| &new.column_error[..])));
        header.spared = self.joined_spared(&sources, new);
        header.sharing_bias = self.joined_bias(earlier.sharing_bias, new.and_then(|new| new.sharing_bias));
        header.preview_blocks = new.map_or(0, |new| new.preview_blocks);
        header.ended_by_time = new.is_some_and(|new| new.ended_by_time);
        if new.is_some_and(|new| new.grounds.is_none()) {
            header.grounds = None;
        }
        if let (Some(grounds), Some(there)) = (&mut header.grounds, &earlier.grounds) {
            let of_light = |(old, of_job): &(Option<usize>, usize)| {
                old.map_or_else(|| self.lights[*of_job].clone(), |old| there.lights[old].clone())
            };
            grounds.lights = sources.iter().map(of_light).collect();
        }
        header
    }

    fn joined_basis(&self, sources: &[(Option<usize>, usize)], new: Option<&BakeHeader>) -> LightBasis {
        let mut next = 0;
        let mut follow = |len: u32| {
            next += len;
            next - len..next
        };
        let source = |&(_, of_job): &(Option<usize>, usize)| {
            let source = self.basis.sources[of_job].clone();
            LightSource { columns: follow(source.columns.len() as u32), ..source }
        };
        let sources = sources.iter().map(source).collect();
        let mut next = 0;
        let earlier = &self.earlier.header.basis.groups;
        let kept = self.parts.iter().map(|part| (earlier[part.group].kind, part.columns.len() as u32));
        let added = new.into_iter().flat_map(|new| &new.basis.groups).map(|g| (g.kind, g.columns.len() as u32));
        let group = |(kind, len): (ColumnKind, u32)| {
            next += len;
            ColumnGroup { kind, columns: next - len..next }
        };
        let groups = kept.chain(added).map(group).collect();
        let LightBasis { sky, spots, muted, .. } = self.basis.clone();
        let basis = LightBasis { sources, groups, sky, spots, muted };
        match &self.header.patches {
            Some(patches) => basis.with_patches(patches.n_columns() as u32),
            None => basis,
        }
    }

    /// [`BakeHeader::together`] of the whole, given its header without that.
    fn joined_together(&self, header: &BakeHeader, new: Option<&BakeHeader>) -> Option<Vec<u32>> {
        let there = self.earlier.header.groups_together();
        let kept = (0u32..).zip(&self.parts).filter(|(_, part)| there.contains(&(part.group as u32)));
        let added = new.into_iter().flat_map(BakeHeader::groups_together).map(|group| self.parts.len() as u32 + group);
        let together: Vec<u32> = kept.map(|(number, _)| number).chain(added).collect();
        (together != header.groups_together()).then_some(together)
    }

    fn joined_spared(&self, sources: &[(Option<usize>, usize)], new: Option<&BakeHeader>) -> Spared {
        let earlier = &self.earlier.header.spared;
        let n_kept = sources.len() - self.fresh.len();
        let is_dark = |(nth, (old, _)): (usize, &(Option<usize>, usize))| {
            let is_dark = match old {
                Some(old) => earlier.dark_sources.contains(&(*old as u32)),
                None => new.is_some_and(|new| new.spared.dark_sources.contains(&((nth - n_kept) as u32))),
            };
            is_dark.then_some(nth as u32)
        };
        Spared {
            dark_sources: sources.iter().enumerate().filter_map(is_dark).collect(),
            reused_columns: self.n_kept_columns() as u32,
            ..new.map_or(earlier, |new| &new.spared).clone()
        }
    }

    /// The mean over all columns.
    fn joined_bias(&self, earlier: Option<f32>, new: Option<f32>) -> Option<f32> {
        let (kept, traced) = (self.n_kept_columns() as f32, self.n_traced_columns() as f32);
        match (earlier, new) {
            (Some(old), Some(new)) => Some((old * kept + new * traced) / (kept + traced)),
            (old, None) => old,
            (None, new) => new,
        }
    }
}

/// Sources with what they rest on.
type Lights<'a> = (&'a [LightSource], &'a [String]);

/// Which source of an earlier bake each source is, by their index in both, in the order of the later ones: rather one of the same
/// name than another one of the same light.
fn pairs((earlier, there): Lights, (sources, wanted): Lights) -> Vec<(usize, usize)> {
    let mut is_taken = vec![false; earlier.len()];
    let mut found = vec![None; sources.len()];
    for by_name in [true, false] {
        for (new, source) in sources.iter().enumerate() {
            let fits = |&old: &usize| {
                let alike =
                    serves(&there[old], &wanted[new]) && earlier[old].kind.column_kind() == source.kind.column_kind();
                alike && !is_taken[old] && (!by_name || earlier[old].key == source.key)
            };
            if let Some(old) = (0..earlier.len().min(there.len())).find(fits).filter(|_| found[new].is_none()) {
                is_taken[old] = true;
                found[new] = Some(old);
            }
        }
    }
    found.into_iter().enumerate().filter_map(|(new, old)| Some((old?, new))).collect()
}

/// What is left of each group of columns.
fn parts(earlier: &LightBasis, pairs: &[(usize, usize)]) -> Vec<Part> {
    let part = |(nth, group): (usize, &ColumnGroup)| {
        let within =
            earlier.sources.iter().enumerate().filter(|(_, source)| group.columns.contains(&source.columns.start));
        let kept = within.filter_map(|(old, _)| pairs.iter().find(|pair| pair.0 == old).copied());
        let sources: Vec<(usize, usize)> = kept.collect();
        let of_source = |&(old, _): &(usize, usize)| earlier.sources[old].columns.clone();
        let columns: Vec<u32> = sources.iter().flat_map(of_source).map(|column| column - group.columns.start).collect();
        let is_whole = columns.len() == group.columns.len();
        (!columns.is_empty()).then_some(Part { group: nth, columns, is_whole, sources })
    };
    earlier.groups.iter().enumerate().filter_map(part).collect()
}
