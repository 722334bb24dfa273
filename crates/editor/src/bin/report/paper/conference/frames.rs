//! Frames of one room by every way in turn: ours on the CPU and on each device, and the full matrix.

use std::time::Instant;

use anyhow::{Context, Result};
use clerestory_relight::bandwidth::ReadProbe;
use clerestory_relight::{CpuRelighter, DeviceChoice, DisplayParams, Frame, Gpu, GpuRelighter, Radiance, Relight};
use clerestory_transport::bake::Bake;
use clerestory_transport::basis::LightBasis;
use clerestory_transport::light::LightRig;

use super::super::lights::told_psnr_db;
use crate::desk::Desk;
use crate::fit::{digits, median, spread_words};
use crate::goal::Goal;
use crate::methods::planes::Planes;

/// What the paper reached on a laptop's GPU of its day, milliseconds.
const PAPER: Goal = Goal::Most(1000.0);
/// Bytes of a pixel's radiance.
const RADIANCE_BYTES: usize = 12;

/// Bakes by their options.
pub(super) type Bakes = [(&'static str, Bake); 2];

/// What makes the frames.
pub(super) struct Racers<'a> {
    pub basis: &'a LightBasis,
    pub bakes: &'a Bakes,
    pub dense: &'a Planes,
}

/// What was measured, and the last frame of each of ours and of the full matrix.
pub(super) struct Frames {
    pub table: String,
    /// Mean PSNR of each of ours against the full matrix, dB.
    pub psnr_db: [f64; 2],
    pub shown: [Radiance; 2],
    pub full: Radiance,
}

/// A way, the milliseconds of its frames, and the bytes that each one moves where they are known.
struct Way {
    name: String,
    millis: Vec<f64>,
    n_bytes: Option<usize>,
}

impl Way {
    fn new(name: String) -> Way {
        Way { name, millis: Vec::new(), n_bytes: None }
    }
}

/// One of ours, ready on the CPU and on each device of a kind.
struct Ours<'a> {
    how: &'static str,
    bake: &'a Bake,
    cpu: CpuRelighter,
    gpus: Vec<Gpu>,
    devices: Vec<GpuRelighter>,
    /// What the CPU made last.
    shown: Radiance,
}

impl<'a> Ours<'a> {
    fn new((how, bake): &'a (&'static str, Bake), choice: DeviceChoice) -> Result<Ours<'a>> {
        let frame = Frame { width: bake.header.width, height: bake.header.height, groups: bake.groups.clone() };
        let gpus = Gpu::all_headless(choice);
        let devices = gpus.iter().map(|gpu| GpuRelighter::new(gpu, &frame)).collect::<Result<Vec<_>, _>>()?;
        Ok(Ours { how, bake, cpu: CpuRelighter::new(&frame)?, gpus, devices, shown: Radiance::default() })
    }

    /// The CPU first, without any frames.
    fn ways(&self) -> Vec<Way> {
        let way = |on: &str| Way::new(format!("ours, {}, on {on}", self.how));
        let mut ways = vec![way("the CPU")];
        ways.extend(self.gpus.iter().map(|gpu| way(&gpu.description())));
        ways
    }

    /// The milliseconds of a frame by each of them.
    fn relit(&mut self, rig: &LightRig) -> Result<Vec<f64>> {
        let (header, display) = (&self.bake.header, DisplayParams::default());
        let mut taken = vec![millis(|| Ok(self.cpu.relight(&header.coefficients(rig), &mut self.shown)?))?];
        for (gpu, device) in self.gpus.iter().zip(&mut self.devices) {
            taken.push(millis(|| {
                device.relight_to_texture(&header.coefficients(rig), &display)?;
                Ok(gpu.wait()?)
            })?);
        }
        Ok(taken)
    }
}

impl Racers<'_> {
    /// Every way in turn with every rig but the first, which all get ready with.
    ///
    /// # Errors
    /// If a frame cannot be relit.
    pub(super) fn race(&self, desk: &Desk, rigs: &[LightRig]) -> Result<Frames> {
        let (first, rigs) = rigs.split_first().context("there are frames")?;
        desk.say("relighting it");
        let [by_default, plain] = self.bakes.each_ref().map(|bake| Ours::new(bake, DeviceChoice::Any));
        let mut ours = [by_default?, plain?];
        let mut full = Radiance::default();
        let dense = |rig: &LightRig, full: &mut Radiance| {
            millis(|| {
                self.dense.relight(&self.basis.project(rig), full);
                Ok(())
            })
        };
        let mut ways: Vec<Vec<Way>> = ours.iter().map(Ours::ways).collect();
        let mut dense_way = Way::new("full matrix on the CPU".into());
        ours.iter_mut().try_for_each(|ours| ours.relit(first).map(drop))?;
        dense(first, &mut full)?;

        let probe = ReadProbe::new(desk.choose(64 << 20, 1 << 30));
        let (mut memory, mut psnr_db) = (0f64, [0.0; 2]);
        for rig in rigs {
            for (ours, ways) in ours.iter_mut().zip(&mut ways) {
                ways.iter_mut().zip(ours.relit(rig)?).for_each(|(way, millis)| way.millis.push(millis));
            }
            dense_way.millis.push(dense(rig, &mut full)?);
            memory = memory.max(probe.bytes_per_sec(u64::MAX));
            for (ours, psnr_db) in ours.iter().zip(&mut psnr_db) {
                *psnr_db += told_psnr_db(&ours.shown, &full)? / rigs.len() as f64;
            }
        }
        let n_written = RADIANCE_BYTES * full.pixels.len();
        for (ours, ways) in ours.iter().zip(&mut ways) {
            ways[0].n_bytes = Some(ours.cpu.stats().n_bytes as usize + n_written);
        }
        dense_way.n_bytes = Some(self.dense.n_bytes() + n_written);
        let mut ways: Vec<Way> = ways.into_iter().flatten().collect();
        ways.insert(1, dense_way);
        Ok(Frames { table: table(&ways, memory), psnr_db, shown: ours.map(|ours| ours.shown), full })
    }
}

/// Ours alone on the CPU and on each device of a kind, as a table: every rig but the first, which all get ready with.
///
/// # Errors
/// If a frame cannot be relit.
pub(super) fn alone(bakes: &Bakes, rigs: &[LightRig], choice: DeviceChoice) -> Result<String> {
    let (first, rigs) = rigs.split_first().context("there are frames")?;
    let mut all = Vec::new();
    for bake in bakes {
        let mut ours = Ours::new(bake, choice)?;
        ours.relit(first)?;
        let mut ways = ours.ways();
        for rig in rigs {
            ways.iter_mut().zip(ours.relit(rig)?).for_each(|(way, millis)| way.millis.push(millis));
        }
        all.extend(ways);
    }
    Ok(table_of_times(&all))
}

/// All ways by their times alone.
fn table_of_times(ways: &[Way]) -> String {
    let row = |way: &Way| {
        let word = median(&way.millis).map_or("not measured", |millis| PAPER.word(millis));
        format!("| {} | {} | {word} |\n", way.name, spread_words(way.millis.clone()))
    };
    let head = "| what | ms per frame | under 1 s, as the paper |\n|---|---|---|\n";
    head.to_string() + &ways.iter().map(row).collect::<String>()
}

fn millis(work: impl FnOnce() -> Result<()>) -> Result<f64> {
    let begun = Instant::now();
    work()?;
    Ok(1e3 * begun.elapsed().as_secs_f64())
}

/// All ways, and what their bytes and times say of each other.
fn table(ways: &[Way], memory: f64) -> String {
    let row = |way: &Way| {
        let millis = median(&way.millis).unwrap_or(f64::NAN);
        let [megabytes, rate, share] = way.n_bytes.map_or(["—"; 3].map(String::from), |n_bytes| {
            let rate = n_bytes as f64 / 1e6 / millis;
            [format!("{:.0}", n_bytes as f64 / 1e6), format!("{rate:.1}"), format!("{:.0} %", 1e11 * rate / memory)]
        });
        let words = spread_words(way.millis.clone());
        format!("| {} | {words} | {megabytes} | {rate} | {share} | {} |\n", way.name, PAPER.word(millis))
    };
    format!(
        "Milliseconds by the clock, on the CPU until the radiance is there, on a device until the picture for the display is, waited for; median (least…greatest). Megabytes that must move: factors as ours keeps them in memory, or the full matrix in single precision, laid out\n\
         so that it is read once from front to back and asked for ahead, and the radiance that is written. Memory was read at {:.1} GB/s at best in the same turns, of which each way reaches the share that is told. {}\n\
         The paper tells less than a second on the GPU of a laptop of its day.\n\n\
         | what | ms per frame | MB | GB/s | of memory | under 1 s, as the paper |\n|---|---|---|---|---|---|\n{}",
        memory / 1e9,
        beside(ways),
        ways.iter().map(row).collect::<String>(),
    )
}

/// Ours as by default beside the full matrix, the first two ways.
fn beside(ways: &[Way]) -> String {
    let [ours, full, ..] = ways else { return String::new() };
    let ratio = |a: f64, b: f64| digits(a / b);
    let (Some(of_ours), Some(of_full)) = (median(&ours.millis), median(&full.millis)) else { return String::new() };
    let (Some(bytes), Some(all)) = (ours.n_bytes, full.n_bytes) else { return String::new() };
    let times = if of_full >= of_ours {
        format!("takes {} times as long", ratio(of_full, of_ours))
    } else {
        format!("is ahead of it: ours takes {} times as long", ratio(of_ours, of_full))
    };
    format!(
        "The full matrix moves {} times the bytes of ours as by default and {times}.",
        ratio(all as f64, bytes as f64)
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ways_are_told_with_their_bytes_and_beside_what_the_paper_reached() {
        let way = |name: &str, millis: &[f64], n_bytes: Option<usize>| Way {
            name: name.into(),
            millis: millis.to_vec(),
            n_bytes,
        };
        let ours = way("ours", &[2.0, 1.0, 3.0], Some(60_000_000));
        let full = way("full", &[6.0, 5.0, 9.0], Some(180_000_000));
        let slow = way("slow", &[1500.0, 1400.0, 1600.0], None);
        let told = table(&[ours, full, slow], 64e9);
        assert!(told.contains("read at 64.0 GB/s at best"), "{told}");
        assert!(told.contains("moves 3.0 times the bytes of ours as by default and takes 3.0 times as long"), "{told}");
        assert!(told.contains("\n| ours | 2.0 (1.0…3.0) | 60 | 30.0 | 47 % | kept |\n"), "{told}");
        assert!(told.ends_with("\n| slow | 1500 (1400…1600) | — | — | — | missed |\n"), "{told}");
        let ahead = beside(&[way("ours", &[6.0], Some(60)), way("full", &[3.0], Some(180))]);
        assert!(ahead.ends_with("is ahead of it: ours takes 2.0 times as long."), "{ahead}");
    }

    #[test]
    fn ways_are_told_by_their_times_where_nothing_is_known_of_their_bytes() {
        let way = |name: &str, millis: &[f64]| Way { millis: millis.to_vec(), ..Way::new(name.into()) };
        let told = table_of_times(&[way("ours", &[2.0, 1.0, 3.0]), way("slow", &[1500.0])]);
        assert!(told.ends_with("\n| ours | 2.0 (1.0…3.0) | kept |\n| slow | 1500 | missed |\n"), "{told}");
    }
}
