//! What is typed, as numbers that mean something.

use std::time::Duration;

use clerestory_nystrom::rivals::{Method, UnknownMethod};
use clerestory_relight::Tone;
use clerestory_transport::bake::SIDES;
use clerestory_transport::camera::Film;
use clerestory_transport::emitters::PanelRequest;
use clerestory_transport::sensors::{NodeGrid, SensorGrid, WorkPlane};
use clerestory_transport::sky::{DOME_DIVISIONS, SkyForm};

use super::IesRequest;
use crate::schedule::ScheduleBy;

/// Most pixels of a picture, 8192 × 8192.
const MAX_PIXELS: u64 = 1 << 26;

pub(super) fn parse_size(text: &str) -> Result<Film, String> {
    let problem = || format!("write WIDTHxHEIGHT such as 960x540, each from 1 to {}", Film::MAX_SIDE);
    let (width, height) = text.split_once(['x', 'X', '×']).ok_or_else(problem)?;
    let side = |text: &str| text.parse::<u32>().ok().filter(|side| (1..=Film::MAX_SIDE).contains(side));
    let (width, height) = side(width).zip(side(height)).ok_or_else(problem)?;
    if u64::from(width) * u64::from(height) > MAX_PIXELS {
        return Err(format!("at most {MAX_PIXELS} pixels in all (8192x8192)"));
    }
    Ok(Film { width, height })
}

pub(super) fn parse_block(text: &str) -> Result<u32, String> {
    let side = text.parse().ok().filter(|side| SIDES.contains(side));
    side.ok_or_else(|| "blocks have 8, 16 or 32 pixels to a side".into())
}

pub(in crate::cli) fn parse_panel(text: &str) -> Result<PanelRequest, String> {
    // A node's name may hold '=', a number cannot.
    let (node, resolution) = text.rsplit_once('=').ok_or("write NODE=M such as Ceiling=16")?;
    let resolution: u32 = resolution.parse().map_err(|_| "M must be a whole number from 4 to 64")?;
    if node.is_empty() || !(4..=64).contains(&resolution) {
        return Err("write NODE=M with the name of a node and M from 4 to 64".into());
    }
    Ok(PanelRequest { node: node.into(), resolution })
}

pub(super) fn parse_ies(text: &str) -> Result<IesRequest, String> {
    // A node's name may hold '=' as well as a path may; names do more often.
    match text.rsplit_once('=') {
        Some((key, file)) if !key.is_empty() && !file.is_empty() => {
            Ok(IesRequest { key: key.into(), file: file.into() })
        }
        _ => Err("write KEY=FILE such as Downlight=downlight.ies".into()),
    }
}

pub(super) fn parse_sun_size(text: &str) -> Result<f32, String> {
    let degrees = text.parse::<f32>().ok();
    // A smaller disk is lost between the directions that single precision tells apart.
    let degrees = degrees.filter(|degrees| *degrees == 0.0 || (0.001..=90.0).contains(degrees));
    degrees.ok_or_else(|| "write degrees from 0.001 to 90, such as 0.53, or 0".into())
}

pub(super) fn parse_sensors(text: &str) -> Result<NodeGrid, String> {
    let problem = || format!("write NODE=WxH such as Desk=16x8, each from 1 to {}", SensorGrid::MAX_SIDE);
    let (node, size) = text.rsplit_once('=').filter(|(node, _)| !node.is_empty()).ok_or_else(problem)?;
    let (across, down) = size.split_once(['x', 'X', '×']).ok_or_else(problem)?;
    let side = |text: &str| text.parse::<u32>().ok().filter(|side| (1..=SensorGrid::MAX_SIDE).contains(side));
    let (across, down) = side(across).zip(side(down)).ok_or_else(problem)?;
    Ok(NodeGrid { node: node.into(), size: [across, down] })
}

pub(super) fn parse_work_plane(text: &str) -> Result<WorkPlane, String> {
    let problem = "write HEIGHT or HEIGHT:SPACING in meters, such as 0.75:0.5; the height from 0 to 10000";
    let (height, spacing) = text.split_once(':').map_or((text, None), |(height, spacing)| (height, Some(spacing)));
    let meters = |text: &str| text.parse::<f32>().ok().filter(|m| (0.0..=1e4).contains(m)).ok_or(problem);
    let spacing_m = spacing.map(|text| meters(text).and_then(|m| if m >= 1e-3 { Ok(m) } else { Err(problem) }));
    Ok(WorkPlane { height_m: meters(height)?, spacing_m: spacing_m.transpose()?, floor: None })
}

pub(super) fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| (1e-3..=1e9).contains(x));
    number.ok_or_else(|| "write a number above 0".into())
}

pub(super) fn parse_factor(text: &str) -> Result<[f64; 2], String> {
    let problem = || "write MIN:MAX such as 0:10".to_string();
    let (least, most) = text.split_once(':').ok_or_else(problem)?;
    let number = |text: &str| text.parse::<f64>().ok().filter(|x| (0.0..=1e6).contains(x)).ok_or_else(problem);
    Ok([number(least)?, number(most)?])
}

pub(super) fn parse_patches(text: &str) -> Result<SkyForm, String> {
    let patches = |divisions: &u32| (144 * divisions * divisions + 1).to_string();
    let divisions = DOME_DIVISIONS.into_iter().find(|divisions| patches(divisions) == text);
    divisions.map(SkyForm::Patches).ok_or_else(|| "write 145, 577 or 2305".into())
}

pub(super) fn parse_method(text: &str) -> Result<Method, String> {
    text.parse().map_err(|error: UnknownMethod| error.to_string())
}

pub(super) fn parse_seconds(text: &str) -> Result<Duration, String> {
    let secs = text.parse::<f32>().ok().filter(|secs| *secs > 0.0 && *secs <= 1e6);
    secs.map(Duration::from_secs_f32).ok_or_else(|| "give seconds above 0 and up to 1000000".into())
}

pub(super) fn parse_tolerance(text: &str) -> Result<f32, String> {
    let decibels = text.parse::<f32>().ok().filter(|db| (0.0..=120.0).contains(db));
    decibels.ok_or_else(|| "write decibels from 0 to 120, such as 40".into())
}

pub(super) fn parse_schedule_by(name: &str) -> Result<ScheduleBy, String> {
    match name {
        "lamp" => Ok(ScheduleBy::Lamp),
        "type" => Ok(ScheduleBy::Type),
        _ => Err("give lamp or type".into()),
    }
}

pub(super) fn parse_tone(name: &str) -> Result<Tone, String> {
    serde_json::from_value(name.into()).map_err(|_| "give agx, aces, neutral, reinhard or linear".to_owned())
}
