//! `clerestory sensors`: how many lux arrive at the grids of a baked scene.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Result, bail};
use clerestory_transport::bake::Bake;
use clerestory_transport::light::LightRig;
use clerestory_transport::sensors::SensorGrid;
use glam::Vec3;
use serde::Serialize;
use serde_json::json;

use super::args::SensorsArgs;
use super::console::{Answer, Console};
use super::lamps::{DIRECT_LUX, prepared, stage, warn_of_lacking, warn_of_no_lamps};
use super::view::{load_bake, load_look, or_of_file, spare_look, spare_scene, warn_of_unknown_lights};
use crate::illuminance::{AddedLux, FOOT_CANDLE_LX, LuxFigures, lux_words, of_grid, share_words, write_points};
use crate::look::Look;
use crate::output::{PendingFile, spare_inputs, spare_others};

/// What the sensors of a grid say.
struct Readings<'a> {
    grid: &'a SensorGrid,
    /// Measured points in meters, and their illuminance in lux.
    points: Vec<(Vec3, f32)>,
}

/// A grid in the figures that lighting standards ask for.
#[derive(Clone, Debug, PartialEq, Serialize)]
struct Summary {
    name: String,
    /// Points along u and v.
    size: [u32; 2],
    /// Points that count.
    points: usize,
    average_lux: f64,
    minimum_lux: f64,
    maximum_lux: f64,
    /// U0, minimum over average; `None` in the dark.
    uniformity: Option<f64>,
    /// Ud, minimum over maximum; `None` in the dark.
    diversity: Option<f64>,
}

pub(super) fn sensors(args: &SensorsArgs, console: &mut Console) -> Result<Answer> {
    let document = load_look(args.look.as_deref(), console)?;
    if let Some(output) = &args.output {
        spare_inputs(output, [("transport", args.transport.as_path())])?;
        args.scene.iter().try_for_each(|scene| spare_scene(output, scene))?;
        spare_look(output, args.look.as_deref(), &document)?;
        spare_others(output, &["csv"], |_| false)?;
    }
    let place = args.output.as_deref().map(PendingFile::create).transpose()?;
    let bake = load_bake(&args.transport)?;
    let basis = &bake.header.basis;
    let look = args.choice.of(&or_of_file(document, args.look.as_deref(), basis), Some(basis))?;
    let added = added(args, &bake, &look, console)?;
    let all = readings(&bake, (&look.lights, &added))?;
    if all.is_empty() && bake.header.basis.is_measured() {
        bail!("{} was baked from pictures, which tell no lux; sensors need a scene", args.transport.display());
    }
    if all.is_empty() {
        bail!(
            "{} holds no sensors; bake it again with --sensors NODE=WxH or --work-plane HEIGHT",
            args.transport.display()
        );
    }
    warn_of_unknown_lights(&bake.header.basis, &look, console);
    if let Some(place) = place {
        place.commit(|writer| write_points(writer, all.iter().map(|of| (of.grid.name.as_str(), &of.points[..]))))?;
    }
    let summaries: Vec<Summary> = all.iter().map(Readings::summary).collect();
    let mut lines: Vec<String> = summaries.iter().map(Summary::words).collect();
    let output = args.output.as_deref().map(Path::display);
    lines.extend(
        output.as_ref().map(|output| format!("{output}: {} points", all.iter().map(Readings::len).sum::<usize>())),
    );
    let output = output.map(|output| output.to_string());
    let json = json!({ "grids": summaries, "output": output, "warnings": console.warnings() });
    Ok(Answer { json, words: lines.join("\n") })
}

fn readings<'a>(bake: &'a Bake, light: (&LightRig, &AddedLux)) -> Result<Vec<Readings<'a>>> {
    bake.grids().map(|(set, grid)| Ok(Readings { grid, points: of_grid(bake, (set, grid), light)? })).collect()
}

/// What the lamps of a look add, where the scene is named.
fn added(args: &SensorsArgs, bake: &Bake, look: &Look, console: &mut Console) -> Result<AddedLux> {
    let lamps = look.lights.shining_lamps();
    warn_of_no_lamps([&look.lights], args.scene.as_ref().map(|_| "--scene"), console);
    if lamps.is_empty() {
        return Ok(AddedLux::default());
    }
    let Some(scene) = args.scene.as_deref() else {
        console
            .warn("the look has lamps of its own, whose light the sensors do not count; name the scene with --scene");
        return Ok(AddedLux::default());
    };
    let Some((scene, _)) = stage(bake, &lamps, Some(scene), console)? else { return Ok(AddedLux::default()) };
    if bake.header.patches.is_some() && bake.grids().any(|(set, _)| !bake.header.holds_patches(&bake.irradiance[set])) {
        console.warn(DIRECT_LUX);
    }
    warn_of_lacking(&lamps, args.look.as_deref(), &scene, console);
    let lamps = prepared(&lamps, args.look.as_deref(), &scene, console)?;
    Ok(AddedLux::of_lamps(bake, Arc::new(scene), lamps))
}

impl Readings<'_> {
    fn len(&self) -> usize {
        self.points.len()
    }

    fn summary(&self) -> Summary {
        let figures = LuxFigures::of(self.points.iter().map(|(_, lux)| (f64::from(*lux), 1.0)));
        Summary {
            name: self.grid.name.clone(),
            size: self.grid.size,
            points: figures.points,
            average_lux: figures.average,
            minimum_lux: figures.minimum,
            maximum_lux: figures.maximum,
            uniformity: figures.uniformity(),
            diversity: figures.diversity(),
        }
    }
}

impl Summary {
    fn words(&self) -> String {
        let [across, down] = self.size;
        format!(
            "{}: average {} lx ({} fc), minimum {} lx, maximum {} lx, uniformity U0 {}, Ud {} ({} of {across}×{down} points)",
            self.name,
            lux_words(self.average_lux),
            lux_words(self.average_lux / FOOT_CANDLE_LX),
            lux_words(self.minimum_lux),
            lux_words(self.maximum_lux),
            share_words(self.uniformity),
            share_words(self.diversity),
            self.points,
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn grid(name: &str) -> SensorGrid {
        let triangles = [[Vec3::ZERO, Vec3::X, Vec3::ONE - Vec3::Y], [Vec3::ZERO, Vec3::ONE - Vec3::Y, Vec3::Z]];
        SensorGrid::on_quad(name, &triangles, [2, 1]).unwrap()
    }

    #[test]
    fn a_grid_is_told_by_average_extremes_and_uniformity() {
        let grid = grid("desk");
        let points = [100.0, 500.0, 300.0].map(|lux| (Vec3::ZERO, lux)).to_vec();
        let told = Readings { grid: &grid, points }.summary();
        assert_eq!((told.average_lux, told.minimum_lux, told.maximum_lux), (300.0, 100.0, 500.0));
        assert!((told.uniformity.unwrap() - 1.0 / 3.0).abs() < 1e-12);
        let dark = Readings { grid: &grid, points: vec![(Vec3::ZERO, 0.0)] }.summary();
        assert_eq!((dark.average_lux, dark.uniformity), (0.0, None));
    }
}
