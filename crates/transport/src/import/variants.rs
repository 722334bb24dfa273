//! KHR_materials_variants: several materials for one surface, of which a variant chooses.

use gltf::json::mesh::Primitive;
use gltf::json::{Index, Material, Root};
use serde_json::Value;

use super::ImportError;

/// Name of the extension.
pub(super) const VARIANTS: &str = "KHR_materials_variants";

/// Names of the variants of a file in its order; those without a name are `variant:INDEX`.
pub(super) fn names(document: &Root) -> Vec<String> {
    let extension = document.extensions.as_ref().and_then(|all| all.others.get(VARIANTS)?.get("variants")?.as_array());
    let named = |(index, variant): (usize, &Value)| match variant.get("name").and_then(Value::as_str) {
        Some(name) if !name.is_empty() => name.to_owned(),
        _ => format!("variant:{index}"),
    };
    extension.into_iter().flatten().enumerate().map(named).collect()
}

/// A variant of a file, or what it shows by default.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Variant {
    index: Option<usize>,
}

impl Variant {
    /// The variant of that name.
    ///
    /// # Errors
    /// [`ImportError::Variant`] where the file has none such, with those that it has.
    pub fn find(name: &str, document: &Root, wanted: Option<&str>) -> Result<Variant, ImportError> {
        let Some(wanted) = wanted else { return Ok(Variant::default()) };
        let known = names(document);
        let index = known.iter().position(|name| name == wanted).ok_or_else(|| {
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            ImportError::Variant { name: name.to_owned(), wanted: wanted.to_owned(), known }
        })?;
        Ok(Variant { index: Some(index) })
    }

    /// The material of a primitive: its own where the variant names none.
    pub fn material(self, primitive: &Primitive) -> Option<Index<Material>> {
        self.chosen(primitive).or(primitive.material)
    }

    fn chosen(self, primitive: &Primitive) -> Option<Index<Material>> {
        let index = self.index?;
        let mappings = primitive.extensions.as_ref()?.others.get(VARIANTS)?.get("mappings")?.as_array()?;
        let is_meant = |mapping: &&Value| {
            let variants = mapping.get("variants").and_then(Value::as_array);
            variants.is_some_and(|all| all.iter().any(|one| one.as_u64() == u64::try_from(index).ok()))
        };
        let material = mappings.iter().find(is_meant)?.get("material")?.as_u64()?;
        Some(Index::new(u32::try_from(material).ok()?))
    }
}
