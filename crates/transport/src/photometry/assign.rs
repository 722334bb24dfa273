//! Gives lamps of a loaded scene a measured distribution.

use thiserror::Error;

use super::PhotometricProfile;
use crate::emitters::{Emitter, Lighting, LightingError};
use crate::scene::{PunctualKind, Scene};

/// Why a lamp cannot take a profile.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum AssignError {
    /// No point or spot lamp has that key.
    #[error("no point or spot lamp is named `{key}`; those that can take a profile are: {known}")]
    UnknownLamp {
        /// Key asked for.
        key: String,
        /// Keys that exist.
        known: String,
    },
    /// The lights of the scene cannot be found.
    #[error(transparent)]
    Lighting(#[from] LightingError),
}

/// Gives the point or spot lamp with a key (as in [`crate::basis::LightSource::key`]) a profile, which takes the place of a
/// spot's cone. Its color stays; its strength becomes the profile's largest intensity in candela times `multiplier`.
///
/// # Errors
/// When no such lamp exists.
#[expect(clippy::cast_possible_truncation, reason = "no more profiles than files were read")]
pub fn assign(scene: &mut Scene, key: &str, profile: PhotometricProfile, multiplier: f32) -> Result<(), AssignError> {
    let (lighting, _) = Lighting::new(scene, &[])?;
    let mut known = Vec::new();
    let mut node = None;
    for (source, emitter) in lighting.basis.sources.iter().zip(&lighting.emitters) {
        let Emitter::Punctual(lamp) = emitter else { continue };
        if lamp.kind == PunctualKind::Directional {
            continue;
        }
        if source.key == key {
            node = Some(lamp.node);
        }
        known.push(source.key.as_str());
    }
    let lamp = node.and_then(|node| scene.punctual.iter_mut().find(|lamp| lamp.node == node));
    let Some(lamp) = lamp else {
        let known = if known.is_empty() { "none".to_owned() } else { known[..known.len().min(20)].join(", ") };
        return Err(AssignError::UnknownLamp { key: key.to_owned(), known });
    };
    lamp.intensity = profile.max_candela() * multiplier;
    lamp.profile = Some(scene.profiles.len() as u32);
    scene.profiles.push(profile);
    Ok(())
}
