//! EXT_lights_ies: measured distributions, and the lamps that use them.
//!
//! A node that also has a lamp of KHR_lights_punctual has one lamp, not two: exporters write the plain one for those who
//! cannot read the profile.

use std::collections::HashMap;
use std::path::Path;

use glam::Vec3;
use gltf::json::Root;
use serde_json::Value;

use super::container::Buffers;
use super::files::read_at_most;
use super::report::Notes;
use super::uri::{Locator, data};
use crate::photometry::PhotometricProfile;
use crate::scene::{PunctualKind, PunctualLight};

/// Intensity of a lamp whose profile cannot be read, candela: about that of a light bulb.
pub const SUBSTITUTE_CD: f32 = 100.0;

/// Longest photometric file that is read, bytes; the largest ones of makers have a few hundred kilobytes.
const MOST_BYTES: u64 = 32 << 20;

/// A measured distribution from a file of its own.
///
/// # Errors
/// Why it cannot be had, in words.
pub fn read_profile(path: &Path) -> Result<PhotometricProfile, String> {
    let bytes =
        read_at_most(path, MOST_BYTES).map_err(|error| format!("it cannot be read ({error}); check the path"))?;
    PhotometricProfile::parse(&bytes, &path.display().to_string()).map_err(|error| error.to_string())
}

/// Profiles of a file, each read when a node first asks for it.
pub(super) struct Profiles<'a> {
    document: &'a Root,
    buffers: &'a Buffers<'a>,
    locator: &'a Locator,
    /// Index into `loaded` by index in the file, `None` for those that cannot be had.
    of_file: HashMap<usize, Option<u32>>,
    /// What `Scene::profiles` becomes.
    pub loaded: Vec<PhotometricProfile>,
}

impl<'a> Profiles<'a> {
    pub fn new(document: &'a Root, buffers: &'a Buffers<'a>, locator: &'a Locator) -> Profiles<'a> {
        Profiles { document, buffers, locator, of_file: HashMap::new(), loaded: Vec::new() }
    }

    /// The lamp of a node with the extension: its plain lamp, or a bare one, with the profile that it names.
    pub fn lamp(
        &mut self,
        instance: &Value,
        plain: Option<PunctualLight>,
        bare: PunctualLight,
        name: &str,
        notes: &mut Notes,
    ) -> Option<PunctualLight> {
        if plain.as_ref().is_some_and(|lamp| lamp.kind == PunctualKind::Directional) {
            notes.warn(format!("{name}: a directional lamp cannot have a measured distribution: it is ignored"));
            return plain;
        }
        let multiplier = multiplier(instance).unwrap_or_else(|| {
            notes.warn(format!("{name}: the multiplier of its distribution is out of range: 1 is used"));
            1.0
        });
        let index = instance.get("light").and_then(Value::as_u64).and_then(|index| usize::try_from(index).ok());
        let profile = match index {
            Some(index) => self.profile(index, notes),
            None => None,
        };
        if let (None, Some(plain)) = (profile, &plain) {
            notes.warn(format!("{name}: its measured distribution cannot be had: its plain lamp shines instead"));
            return Some(plain.clone());
        }
        let asked = color(instance);
        let tint = asked.unwrap_or(Vec3::ONE).clamp(Vec3::ZERO, Vec3::ONE);
        if asked != Some(tint) {
            notes.warn(format!("{name}: the color of its distribution is out of range: {tint} is used"));
        }
        let lamp = plain.unwrap_or(bare);
        let color = lamp.color * tint;
        let max_candela = profile.map(|profile| self.loaded[profile as usize].max_candela());
        if max_candela.is_none() {
            notes.warn(format!(
                "{name}: its measured distribution cannot be had: it shines all around with {SUBSTITUTE_CD} cd instead"
            ));
        }
        let intensity = (max_candela.unwrap_or(SUBSTITUTE_CD) * multiplier).min(f32::MAX);
        Some(PunctualLight { profile, color, intensity, ..lamp })
    }

    /// Index into `loaded`, `None` (with a line in the report) if the profile cannot be had.
    #[expect(
        clippy::cast_possible_truncation,
        reason = "no more profiles than nodes; numbers that single precision has no room for become infinite and are refused"
    )]
    fn profile(&mut self, index: usize, notes: &mut Notes) -> Option<u32> {
        if let Some(known) = self.of_file.get(&index) {
            return *known;
        }
        let found = match self.read(index) {
            Ok(profile) => {
                let place = self.loaded.len() as u32;
                profile.remarks().iter().for_each(|remark| notes.warn(format!("light profile {index}: {remark}")));
                self.loaded.push(profile);
                Some(place)
            }
            Err(reason) => {
                notes.warn(format!("light profile {index}: {reason}"));
                None
            }
        };
        self.of_file.insert(index, found);
        found
    }

    fn read(&self, index: usize) -> Result<PhotometricProfile, String> {
        let extension = self.document.extensions.as_ref().and_then(|all| all.others.get("EXT_lights_ies"));
        let entry = extension.and_then(|extension| extension.get("lights")?.get(index));
        let entry = entry.ok_or("it does not exist")?;
        let uri = entry.get("uri").and_then(Value::as_str);
        let view = entry.get("bufferView").and_then(Value::as_u64).and_then(|view| usize::try_from(view).ok());
        let parse = |bytes: &[u8], name: &str| PhotometricProfile::parse(bytes, name).map_err(|e| e.to_string());
        // Data without a file has a name here: that tells EULUMDAT by its end, and is what people know the profile by.
        let name = entry.get("name").and_then(Value::as_str).filter(|name| !name.is_empty()).unwrap_or("its data");
        match (uri, view) {
            (Some(uri), _) if data(uri).is_some() => parse(&self.locator.fetch(uri)?, name),
            (Some(uri), _) => parse(&self.locator.fetch(uri)?, uri),
            (None, Some(view)) => parse(self.buffers.view(view)?.0, name),
            (None, None) => Err("it names no bytes".to_owned()),
        }
    }
}

/// 1 where the file says nothing, `None` for what is no factor.
#[expect(
    clippy::cast_possible_truncation,
    reason = "no more profiles than nodes; numbers that single precision has no room for become infinite and are refused"
)]
fn multiplier(instance: &Value) -> Option<f32> {
    let Some(multiplier) = instance.get("multiplier") else { return Some(1.0) };
    multiplier.as_f64().map(|x| x as f32).filter(|x| x.is_finite() && *x >= 0.0)
}

/// Linear RGB, white where the file says nothing, `None` for what is no color.
#[expect(
    clippy::cast_possible_truncation,
    reason = "no more profiles than nodes; numbers that single precision has no room for become infinite and are refused"
)]
fn color(instance: &Value) -> Option<Vec3> {
    let Some(color) = instance.get("color") else { return Some(Vec3::ONE) };
    let channel = |c: usize| Some(color.get(c)?.as_f64()? as f32);
    Some(Vec3::new(channel(0)?, channel(1)?, channel(2)?))
}
