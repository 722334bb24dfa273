//! What a graphics device of hardware does, and the cores of the machine that it is in.

use anyhow::Result;
use clerestory_relight::{DeviceChoice, Gpu};

use super::desk::Desk;
use super::{growth, latency, paper, relight, sitting, steps};

/// Of the section.
pub const NAME: &str = "hardware";

/// Whether there is such a device: without one the page keeps what was measured elsewhere.
pub fn is_here() -> bool {
    !Gpu::all_headless(DeviceChoice::Hardware).is_empty()
}

/// Relights, drags a slider, moves a lamp, relights a room of twenty lights, sits with each scene, and bakes on more and more threads.
///
/// # Errors
/// If there is no such device, or it fails.
pub fn write(desk: &Desk) -> Result<String> {
    let gpu = Gpu::headless(DeviceChoice::Hardware)?;
    let relit = relight::tables(desk, NAME, DeviceChoice::Hardware)?;
    let dragged = latency::table(desk, NAME, DeviceChoice::Hardware)?;
    let moved = steps::table(desk, NAME, Some(&gpu))?;
    let room = paper::conference::on_devices(desk, NAME, DeviceChoice::Hardware)?;
    let room = if room.is_empty() { room } else { format!("\n### Twenty lights relit\n\n{room}") };
    let sat = sitting::once(desk, NAME, DeviceChoice::Hardware)?;
    let grown = growth::threads::write(desk, NAME)?;
    Ok(format!(
        "## A machine with a graphics card\n\n\
         The tables of *Relighting*, *Latency*, *Steps of a moved lamp*, *A room of twenty lights*, *What a sitting costs* and *Threads* once more, where there is a graphics device of hardware; what their columns mean stands there. {}\n\
         {relit}\n### A slider dragged\n\n{dragged}\n### A lamp moved\n\n{moved}{room}\n\
         ### A sitting on that machine\n\n{sat}{grown}",
        desk.load_words(),
    ))
}
