//! The end of a bake: its factors as few bytes, and the bake as those bytes have it.

use std::sync::Arc;

use clerestory_nystrom::codec::CodecError;
use clerestory_nystrom::{BlockLowRank, PackPlan, PackedMatrix};

use super::focus::Focus;
use super::patches::PATCH_TOLERANCE_DB;
use super::{BRIGHT, Bake, BakeHeader, PackedMatrices, apart, mean_square, truncation_share};
use crate::basis::{ColumnGroup, ColumnKind};
use crate::column_errors::BeforePacking;
use crate::irradiance::IrradianceHeader;

impl Bake {
    /// A bake whose factors are what its file will hold: they differ from those of the blocks that were told of by the
    /// share of the tolerance that packing may use, and say so in their errors.
    /// `None` if nobody wants it any more.
    pub(crate) fn packing(header: Arc<BakeHeader>, matrices: Vec<Vec<BlockLowRank>>, focus: &Focus) -> Option<Bake> {
        let before: Vec<_> = matrices.iter().map(|groups| header.before_packing(groups)).collect();
        // Each group is dropped as soon as it is packed: most factors are never there twice.
        let pack =
            |(group, plan): (BlockLowRank, PackPlan)| (!focus.is_left()).then(|| PackedMatrix::pack(&group, &plan));
        let pack_all = |(groups, plans): (Vec<BlockLowRank>, Vec<PackPlan>)| {
            groups.into_iter().zip(plans).map(pack).collect::<Option<Vec<_>>>()
        };
        let packed = matrices.into_iter().zip(header.pack_plans()).map(pack_all).collect::<Option<_>>()?;
        let mut bake = Bake::unpacking(header, packed).expect("what was just packed can be unpacked");
        for (matrix, before) in before.into_iter().enumerate() {
            let Some(before) = before else { continue };
            let groups = if matrix == 0 { &bake.groups } else { &bake.irradiance[matrix - 1] };
            Arc::make_mut(&mut bake.header).tell_column_error(matrix, before, groups);
        }
        Some(bake)
    }

    /// A bake from the bytes of its factors.
    pub(crate) fn unpacking(header: Arc<BakeHeader>, packed: PackedMatrices) -> Result<Bake, CodecError> {
        let unpack =
            |groups: &Vec<PackedMatrix>| groups.iter().map(PackedMatrix::unpack).collect::<Result<Vec<_>, _>>();
        let mut matrices = packed.iter().map(unpack).collect::<Result<Vec<_>, _>>()?;
        let groups = matrices.remove(0);
        Ok(Bake { header, groups, irradiance: matrices, packed: Some(Arc::new(packed)) })
    }
}

impl BakeHeader {
    /// What is known of the lights of a matrix before its groups are packed.
    pub(super) fn before_packing(&self, groups: &[BlockLowRank]) -> Option<BeforePacking> {
        BeforePacking::new(self.of_lights(groups), &self.basis)
    }

    /// Tells the error of each column of lights of a matrix, given the same groups as they were packed.
    pub(super) fn tell_column_error(&mut self, matrix: usize, before: BeforePacking, packed: &[BlockLowRank]) {
        let column_error = before.after(self.of_lights(packed), &self.basis);
        match matrix {
            0 => self.column_error = column_error,
            _ => self.irradiance[matrix - 1].column_error = column_error,
        }
    }

    /// Of the groups of a matrix those of lights: patches come last.
    fn of_lights<'a>(&self, groups: &'a [BlockLowRank]) -> &'a [BlockLowRank] {
        &groups[..groups.len() - usize::from(self.patches.is_some())]
    }

    /// How each group of each matrix is packed.
    pub(crate) fn pack_plans(&self) -> Vec<Vec<PackPlan>> {
        let allowed = |kind: ColumnKind, tolerance_db: f32| match kind {
            ColumnKind::Patch => mean_square(PATCH_TOLERANCE_DB),
            // What a method without factors made is kept in full: it is off by the method alone, and by 16 bits.
            _ if self.config.method.without_factors().is_some() => 0.0,
            kind => mean_square(tolerance_db) * truncation_share(kind),
        };
        let of_matrix = |column_scale: &[f32], tolerance_db: f32| {
            let file_light = self.basis.file_light(column_scale);
            let plan = |group: &ColumnGroup| PackPlan {
                columns: self.basis.runs(group),
                allowed: allowed(group.kind, tolerance_db),
                strong: BRIGHT,
                // Pictures are compressed together.
                apart: if self.basis.is_measured() { 0.0 } else { apart(group.kind) },
                preserved: file_light[group.columns.start as usize..group.columns.end as usize].to_vec(),
            };
            self.basis.groups.iter().map(plan).collect()
        };
        let tolerance_db = self.config.tolerance_db;
        let of_set = |set: &IrradianceHeader| of_matrix(&set.column_scale, set.rows.tolerance_of_factors(tolerance_db));
        let of_irradiance = self.irradiance.iter().map(of_set);
        std::iter::once(of_matrix(&self.column_scale, tolerance_db)).chain(of_irradiance).collect()
    }
}
