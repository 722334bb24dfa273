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

#[cfg(test)]
mod tests {
    use super::Method;
    use crate::bake::BakeConfig;

    #[test]
    fn only_methods_that_would_fit_noise_have_fewer_ranks_than_a_block_has_rows() {
        let most = |method, block| BakeConfig { method, block, ..BakeConfig::default() }.max_rank();
        assert_eq!([8, 16, 32].map(|block| most(Method::Projected, block)), [192, 768, 3072]);
        assert_eq!([Method::Svd, Method::RowId].map(|method| most(method, 16)), [768, 96]);
    }
}
