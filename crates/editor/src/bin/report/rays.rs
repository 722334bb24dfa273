//! Rays: our tree against the one of the library that clusters its triangles.

use std::ffi::OsStr;
use std::process::Command;

use anyhow::{Context, Result, bail};
use serde_json::Value;

use super::desk::{Desk, number};
use super::goal::Goal;

/// Kinds of rays, in the order of the table.
const KINDS: [&str; 5] = ["primary", "primary16", "bounce", "shadow", "fan16"];
/// Ratios that are aimed at, of the same kinds.
const AIMS: [Option<f64>; 5] = [Some(2.3), Some(2.3), Some(2.1), Some(2.1), None];

/// Runs the example of the transport crate that asks both trees, and puts its figures into a table.
///
/// # Errors
/// If the example cannot be built or fails.
pub fn write(desk: &Desk) -> Result<String> {
    let mut rows = String::new();
    for name in ["conference", "bitterli-living-room"] {
        let Some(path) = desk.shared(&format!("scenes/{name}.glb")) else { continue };
        let told: Vec<Value> = desk.part("rays", name, || rates(desk, name, &[path.as_os_str()]))?;
        rows.extend(told.iter().map(row));
    }
    let hall = ["--hall", desk.choose("100000", "1000000")].map(OsStr::new);
    let told: Vec<Value> = desk.part("rays", "hall", || rates(desk, "the generated hall", &hall))?;
    rows.extend(told.iter().map(row));
    Ok(format!(
        "## Rays\n\n\
         Million rays per second of one thread: ours / obvhs' CWBVH at its slowest preset as it comes = ratio. The same rays, in one process,\n\
         in turn, the best of four passes, CPU time, behind it the ratios of single passes, least…greatest. About {} rays of the camera, one through each pixel of a picture of 4 : 3 (primary: one by one; primary16: the same in packets of 4 × 4 neighbors, single rays where there are no packets); rays scattered on from what it sees; shadow rays towards a panel of\n\
         1 m² under the ceiling; fans of sixteen of them towards neighboring texels (single rays where there are no fans). Builders in CPU\n\
         seconds. Aimed at: {}, what Embree is said to reach with single rays, which this command does not measure: of the camera's rays primary is what is aimed at. Where it is found what pixels see, in the quick picture of a camera in hand and in `trace` they go as packets of sixteen; primary16 is held against the same. Rays of the camera have seed 1, scattered ones 2, shadow rays 3. The last column but one counts rays that the two answer otherwise, hits a thousandth apart, or eight steps of single precision at the corner farthest out, being the same: {}; behind it how many of them ours / the other answers other than all triangles do in double precision. The last column counts rays of the camera that have another hit in their packet than one by one, by a bit or more. {}\n\n\
         | scene | triangles | rays: {} | build | {} | answered otherwise | packets against single rays |\n\
         |---|---|---|---|---|---|---|---|---|---|---|\n{rows}",
        n_rays(desk),
        KINDS
            .iter()
            .zip(AIMS)
            .filter_map(|(kind, aim)| Some(format!("{kind} ≥ {}×", aim?)))
            .collect::<Vec<_>>()
            .join(", "),
        KINDS.join(", "),
        desk.load_words(),
        KINDS.join(", "),
        KINDS.join(" | "),
    ))
}

/// What the example tells of a scene, given as it takes it.
fn rates(desk: &Desk, name: &str, scene: &[&OsStr]) -> Result<Vec<Value>> {
    desk.say(&format!("asking rays of both trees in {name}"));
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let mut example = Command::new(cargo);
    example.args(["run", "--release", "--locked", "-p", "clerestory-transport", "--example", "ray_rates", "--"]);
    example.args(["--rays", n_rays(desk)]).args(scene).current_dir(&desk.root);
    let told = example.output().context("cannot run cargo")?;
    if !told.status.success() {
        bail!("the example ray_rates failed: {}", String::from_utf8_lossy(&told.stderr));
    }
    serde_json::from_slice(&told.stdout).context("the example ray_rates printed no JSON")
}

/// About so many rays of the camera, as the example takes them.
fn n_rays(desk: &Desk) -> &'static str {
    desk.choose("100000", "1000000")
}

fn row(scene: &Value) -> String {
    let none = Vec::new();
    let kinds = scene["kinds"].as_array().unwrap_or(&none);
    let of = |kind: &str| kinds.iter().find(|value| value["kind"] == kind).unwrap_or(&Value::Null);
    let verdict =
        |aim: Option<f64>, ratio: f64| aim.map_or(String::new(), |aim| format!(", {}", Goal::Least(aim).word(ratio)));
    let rates = KINDS.map(|kind| {
        let (ours, theirs) = (number(of(kind), "/ours"), number(of(kind), "/theirs"));
        let [least, greatest] = ["/ratios/0", "/ratios/1"].map(|at| number(of(kind), at));
        (format!("{ours:.1} / {theirs:.1} = {:.2}× ({least:.2}…{greatest:.2})", ours / theirs), ours / theirs)
    });
    let differ = KINDS.map(|kind| {
        let [differ, ours, theirs] = ["/differ", "/wrong/ours", "/wrong/theirs"].map(|at| number(of(kind), at));
        if differ > 0.0 { format!("{differ:.0} ({ours:.0} / {theirs:.0})") } else { format!("{differ:.0}") }
    });
    format!(
        "| {} | {:.0} | {} | {:.2} / {:.2} | {} | {} | {:.0} |\n",
        scene["scene"].as_str().unwrap_or("scene"),
        number(scene, "/triangles"),
        KINDS.map(|kind| format!("{:.0}", number(of(kind), "/rays"))).join(", "),
        number(scene, "/build_secs/ours"),
        number(scene, "/build_secs/theirs"),
        rates
            .iter()
            .zip(AIMS)
            .map(|((words, ratio), aim)| words.clone() + &verdict(aim, *ratio))
            .collect::<Vec<_>>()
            .join(" | "),
        differ.join(", "),
        number(of("primary16"), "/other_than_single"),
    )
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn rays_that_are_answered_otherwise_are_told_with_who_is_wrong() {
        let kind = |kind: &str, differ: u32| {
            json!({
                "kind": kind, "rays": 640, "ours": 20.0, "theirs": 8.0, "ratios": [2.4, 2.6],
                "differ": differ, "wrong": { "ours": 1, "theirs": 94 },
            })
        };
        let mut single = kind("primary", 0);
        single["ours"] = json!(16.0);
        let mut packets = kind("primary16", 0);
        packets["other_than_single"] = json!(3);
        let kinds = [single, packets, kind("bounce", 95), kind("shadow", 0), kind("fan16", 0)];
        let told = row(&json!({
            "scene": "hall", "triangles": 12, "build_secs": { "ours": 1.0, "theirs": 2.0 }, "kinds": kinds,
        }));
        assert!(told.starts_with("| hall | 12 | 640, 640, 640, 640, 640 | 1.00 / 2.00 |"), "{told}");
        let ratio = "20.0 / 8.0 = 2.50× (2.40…2.60)";
        let single = "16.0 / 8.0 = 2.00× (2.40…2.60), missed";
        assert!(
            told.contains(&format!("| {single} | {ratio}, kept | {ratio}, kept | {ratio}, kept | {ratio} |")),
            "{told}"
        );
        assert!(told.ends_with("| 0, 0, 95 (1 / 94), 0, 0 | 3 |\n"), "{told}");
    }
}
