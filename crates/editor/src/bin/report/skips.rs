//! Skips: work that a bake found needless.

use anyhow::Result;

use super::cases::cases;
use super::desk::{Desk, number};

/// Tolerance in dB, one that most blocks of a plain scene can reach.
const TOLERANCE: &str = "30";

/// Bakes scenes and tells what they skipped.
///
/// # Errors
/// If a scene cannot be baked.
pub fn write(desk: &Desk) -> Result<String> {
    let (mut rows, mut spp) = (String::new(), "");
    for case in cases(desk) {
        desk.say(&format!("skipping in {}", case.name));
        let transport = desk.file(&format!("{}.transport", case.name));
        let [_, told] = case.bake(&transport, TOLERANCE)?;
        rows += &format!(
            "| {} | {} | {:.0} | {:.0} | {:.0} | {:.0} % | {:.1} |\n",
            case.name,
            case.size.replace('x', "×"),
            number(&told, "/blocks"),
            number(&told, "/skipped/dark_blocks"),
            number(&told, "/skipped/converged_blocks"),
            100.0 * number(&told, "/skipped/samples_saved"),
            number(&told, "/error_db/total"),
        );
        spp = case.spp;
    }
    Ok(format!(
        "## Work that was skipped\n\n\
         Bakes of at most {spp} samples per pixel, asked for {TOLERANCE} dB. Dark blocks hold no light of a group of columns at all (each group\n\
         counts by itself); converged ones reached the tolerance before all samples were taken.\n\n\
         | scene | size | blocks | dark | converged | samples saved | error dB |\n\
         |---|---|---|---|---|---|---|\n{rows}"
    ))
}
