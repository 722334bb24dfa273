//! `clerestory cache`: the bakes that the editor keeps for the next time.

use anyhow::{Context, Result};
use serde_json::json;

use super::args::CacheArgs;
use super::console::Answer;
use crate::bake_cache::{BakeCache, FOLDER_VARIABLE};
use crate::sizes::bytes_words;

pub(super) fn cache(args: &CacheArgs) -> Result<Answer> {
    let cache = BakeCache::of_user()?;
    let cache =
        cache.with_context(|| format!("this system has no folder for caches; set {FOLDER_VARIABLE} to a folder"))?;
    let usage = if args.clear { cache.clear()? } else { cache.usage()? };
    let json = json!({
        "folder": cache.folder().display().to_string(),
        "bakes": usage.bakes,
        "bytes": usage.bytes,
        "limit_bytes": cache.limit_bytes(),
        "cleared": args.clear,
    });
    let (folder, what) = (cache.folder().display(), if args.clear { "removed" } else { "kept" });
    let words = format!(
        "{folder}: {} bakes {what}, {} of at most {}",
        usage.bakes,
        bytes_words(usage.bytes),
        bytes_words(cache.limit_bytes())
    );
    Ok(Answer { json, words })
}
