//! `clerestory schedule`: a table of all lamps.

use std::path::Path;

use anyhow::{Context, Result, ensure};
use clerestory_transport::import::Choice;
use clerestory_transport::prepared::PreparedScene;
use clerestory_transport::sensors::floor_area_m2;
use serde_json::json;

use super::args::ScheduleArgs;
use super::console::{Answer, Console};
use super::view::{
    count_in_watts, load_bake, load_look, load_scene, or_of_file, panels, spare_look, spare_scene,
    warn_of_unknown_lights,
};
use crate::action::is_transport;
use crate::legend::number_words;
use crate::output::{PendingFile, spare_inputs, spare_others};
use crate::schedule::Schedule;

pub(super) fn run(args: &ScheduleArgs, console: &mut Console) -> Result<Answer> {
    let look = load_look(args.look.as_deref(), console)?;
    let is_bake = is_transport(&args.file);
    match is_bake {
        true => spare_inputs(&args.output, [("transport", args.file.as_path())])?,
        false => spare_scene(&args.output, &args.file)?,
    }
    spare_look(&args.output, args.look.as_deref(), &look)?;
    spare_others(&args.output, &["csv"], |_| false)?;
    let place = PendingFile::create(&args.output)?;
    let (basis, scene) = if is_bake {
        let bake = load_bake(&args.file)?;
        ensure!(!bake.header.basis.is_measured(), "{} is of pictures, whose lights are no lamps", args.file.display());
        (bake.header.basis.clone(), None)
    } else {
        let mut scene = load_scene(&args.file, &Choice::default(), console)?.scene;
        count_in_watts(&mut scene, false, look.scene.units, console);
        let panels = panels(&scene, &[], &look.scene, console);
        let (scene, warnings) = PreparedScene::new(scene, &panels)
            .with_context(|| format!("cannot prepare the scene {}", args.file.display()))?;
        console.warn_all(warnings);
        (scene.lighting.basis.clone(), Some(scene))
    };
    let mut look = or_of_file(look, args.look.as_deref(), &basis);
    // Photometric files lie beside the look, wherever the command is given.
    look.resolve(args.look.as_deref().and_then(Path::parent).unwrap_or(Path::new("")));
    warn_of_unknown_lights(&basis, &look, console);
    let floor = args.floor_m2.or_else(|| scene.as_ref().and_then(|scene| floor_area_m2(&scene.scene)).map(f64::from));
    let schedule = Schedule::new(&basis, scene.as_ref(), &look, args.efficacy, floor);
    console.warn_all(schedule.untold());
    place.commit(|writer| schedule.write(writer, args.by))?;
    let number = |x: f64| number_words(x as f32);
    let density = schedule.watt_per_m2().map_or(String::new(), |density| {
        format!(", {} W/m² of {} m² of floor", number(density), number(schedule.floor_m2.unwrap_or(0.0)))
    });
    let per_watt = schedule.lumen_per_watt().map_or(String::new(), |efficacy| format!(", {} lm/W", number(efficacy)));
    let unknown = match schedule.n_unknown_watt() {
        0 => String::new(),
        n => format!("; {n} of unknown wattage"),
    };
    let output = args.output.display().to_string();
    let n_on = schedule.luminaires.iter().filter(|lamp| lamp.is_on).count();
    let words = format!(
        "{output}: {n_on} of {} lamps on, {} lm, {} W{per_watt}{density}{unknown}",
        schedule.luminaires.len(),
        number(schedule.lumen()),
        number(schedule.watt()),
    );
    let json = json!({
        "output": output, "by": args.by, "luminaires": schedule.luminaires, "types": schedule.types(),
        "lumen": schedule.lumen(), "watt": schedule.watt(), "n_unknown_watt": schedule.n_unknown_watt(),
        "lumen_per_watt": schedule.lumen_per_watt(), "efficacy_lm_w": schedule.efficacy_lm_w,
        "floor_m2": schedule.floor_m2, "watt_per_m2": schedule.watt_per_m2(), "warnings": console.warnings(),
    });
    Ok(Answer { json, words })
}
