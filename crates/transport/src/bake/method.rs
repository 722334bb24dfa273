//! A method as a header holds it: by its name.

use clerestory_nystrom::rivals::Method;
use serde::{Deserialize, Deserializer, Serializer, de::Error};

/// Headers name no method but those that are there for comparison.
pub(super) fn is_default(method: &Method) -> bool {
    *method == Method::default()
}

pub(super) fn serialize<S: Serializer>(method: &Method, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(method)
}

pub(super) fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Method, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}
