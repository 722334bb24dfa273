//! What `clerestory bake` takes over from an earlier bake: the file that it is to write, or one that is named.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use clerestory_transport::archive;
use clerestory_transport::bake::BakeJob;
use clerestory_transport::bake::reuse::{NothingKept, Reuse};
use serde_json::{Value, json};

use super::args::BakeArgs;
use super::console::Console;
use crate::platform::memory_bytes;

/// An earlier bake, and what of it is taken over.
pub(super) struct Earlier {
    path: PathBuf,
    /// Or why nothing is.
    pub reuse: Result<Reuse, NothingKept>,
}

impl Earlier {
    /// The bake that was named, else the output of an earlier one, if there is any and nobody wants to start over.
    ///
    /// # Errors
    /// If the one that was named cannot be read.
    pub fn find(job: &BakeJob, args: &BakeArgs, output: &Path, console: &mut Console) -> Result<Option<Earlier>> {
        let is_wanted = !args.options.fresh;
        let path = args.reuse.as_deref().or_else(|| Some(output).filter(|output| is_wanted && is_filled(output)));
        let Some(path) = path else { return Ok(None) };
        let most = args.memory.into_iter().chain(memory_bytes()).min();
        let bake = match archive::read_within(most, path) {
            Ok(bake) => bake,
            Err(error) if args.reuse.is_some() => {
                return Err(error).context("cannot take anything over");
            }
            // It is about to be replaced, whatever it is.
            Err(error) => {
                console.warn(&format!("nothing is taken over: {error}"));
                return Ok(None);
            }
        };
        let reuse = job.reuse(&bake);
        if let (Err(why), true) = (&reuse, args.reuse.is_some()) {
            console.warn(&format!("nothing of {} is taken over: {why}", path.display()));
        }
        Ok(Some(Earlier { path: path.to_path_buf(), reuse }))
    }

    /// For programs.
    pub fn json(&self) -> Value {
        let from = self.path.display().to_string();
        match &self.reuse {
            Ok(reuse) => json!({
                "from": from,
                "columns": reuse.n_kept_columns(),
                "traced_columns": reuse.n_traced_columns(),
                "traced_irradiance": reuse.n_added_rows(),
            }),
            Err(why) => json!({ "from": from, "columns": 0, "why_not": why.to_string() }),
        }
    }

    /// For people: a line of its own.
    pub fn words(&self) -> String {
        let path = self.path.display();
        match &self.reuse {
            Ok(reuse) => {
                let (kept, traced) = (reuse.n_kept_columns(), reuse.n_traced_columns());
                let rows = match reuse.n_added_rows() {
                    0 => String::new(),
                    1 => "; the irradiance that it lacked is traced".into(),
                    n => format!("; {n} matrices of irradiance that it lacked are traced"),
                };
                format!("\ntaken over  {kept} of {} columns from {path}, {traced} traced{rows}", kept + traced)
            }
            Err(why) => format!("\ntaken over  nothing from {path}: {why}"),
        }
    }
}

fn is_filled(path: &Path) -> bool {
    path.metadata().is_ok_and(|of| of.is_file() && of.len() > 0)
}
