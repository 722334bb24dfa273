//! Free lamps as lights of a scene, each with a column of its own: the reference of what is computed live.

use glam::Vec3;

use super::light::Form;
use super::{LampError, PreparedLamps};
use crate::basis::{ColumnGroup, ColumnKind, LightSource, SourceKind};
use crate::emitters::Emitter;
use crate::origin::LightOrigin;
use crate::prepared::PreparedScene;
use crate::scene::PunctualKind;

impl PreparedLamps {
    /// Gives the lamps columns behind those of the scene, which stay as they are. A body is seen where it shines, and nothing
    /// stops at it: light of all lamps adds up.
    ///
    /// # Errors
    /// A lamp with the key of a light of the scene.
    pub fn install(&self, scene: &mut PreparedScene) -> Result<(), LampError> {
        let lighting = &mut scene.lighting;
        let basis = &mut lighting.basis;
        if let Some(lamp) = self.lamps().iter().find(|lamp| basis.source(&lamp.key).is_some()) {
            return Err(LampError::Taken { key: lamp.key.clone() });
        }
        let first = basis.n_cols() as u32;
        for (column, prepared) in (first..).zip(self.lamps()) {
            let kind = match &prepared.lamp.form {
                Form::Point { light, .. } => match light.kind {
                    PunctualKind::Spot { .. } => SourceKind::Spot,
                    _ => SourceKind::Point,
                },
                Form::Distant { .. } => SourceKind::Directional,
                Form::Body(_) => SourceKind::Emitter,
            };
            let (key, columns) = (prepared.key.clone(), column..column + 1);
            let strength = prepared.emission.max_element();
            let color = if strength > 0.0 { prepared.emission / strength } else { Vec3::ONE };
            let origin = LightOrigin::default();
            basis.sources.push(LightSource { key, kind, columns, color, strength, origin });
            lighting.emitters.push(Emitter::Lamp(prepared.lamp.clone()));
        }
        let last = first + self.lamps().len() as u32;
        if last > first {
            basis.groups.push(ColumnGroup { kind: ColumnKind::Luminaire, columns: first..last });
        }
        Ok(())
    }
}
