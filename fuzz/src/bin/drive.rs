//! Feeds a target with mutated files for some seconds: `drive TARGET SECONDS [SEED]`. Inputs that make it panic or take
//! longer than `SLOW` are written to the folder `artifacts`.

use std::panic::catch_unwind;
use std::time::{Duration, Instant};

use clerestory_fuzz::mutate::{Dice, mutated};
use clerestory_fuzz::{seeds, targets};

#[cfg(feature = "look")]
#[path = "../documents.rs"]
mod documents;

const SLOW: Duration = Duration::from_secs(2);

fn main() {
    let args: Vec<String> = std::env::args().collect();
    let usage = || format!("drive TARGET SECONDS [SEED]; targets: {}", seeds::TARGETS.join(", "));
    let (name, secs) = match args.as_slice() {
        [_, name, secs, ..] => (name.as_str(), secs.parse().unwrap_or_else(|_| panic!("{}", usage()))),
        _ => panic!("{}", usage()),
    };
    let seed = args.get(3).map_or(1, |seed| seed.parse().expect("a seed is a number"));
    let target: fn(&[u8]) = match name {
        "gltf" => targets::gltf,
        "meshopt" => targets::meshopt,
        "photometry" => targets::photometry,
        "sky" => targets::sky,
        "picture" => targets::picture,
        "archive" => targets::archive,
        #[cfg(feature = "look")]
        "look" => documents::look,
        #[cfg(feature = "look")]
        "wishes" => documents::wishes,
        _ => panic!("{}", usage()),
    };
    let files = seeds::of(name);
    files.iter().for_each(|file| target(file));
    let (begun, mut n_cases, mut n_found, mut slowest) = (Instant::now(), 0_u64, 0, Duration::ZERO);
    while begun.elapsed() < Duration::from_secs(secs) {
        let mut dice = Dice(seed ^ (n_cases << 20));
        let (one, other) = (dice.below(files.len()), dice.below(files.len()));
        let bytes = mutated(&files[one], &files[other], &mut dice);
        let started = Instant::now();
        let survived = catch_unwind(|| target(&bytes)).is_ok();
        let took = started.elapsed();
        slowest = slowest.max(took);
        if !survived || took > SLOW {
            n_found += 1;
            let _ = std::fs::create_dir_all("artifacts");
            let path = format!("artifacts/{name}-{seed}-{n_cases}");
            println!("{path}: {} after {took:?}", if survived { "slow" } else { "panic" });
            std::fs::write(&path, &bytes).expect("the folder can be written");
        }
        n_cases += 1;
    }
    let (ms, peak) = (slowest.as_millis(), peak_mib());
    println!("{name}: {n_cases} files in {secs} s, {n_found} found, slowest {ms} ms, memory at most {peak} MiB");
    assert!(n_found == 0, "{n_found} found");
}

/// Most memory that this process ever had, MiB; 0 where the system does not tell.
fn peak_mib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    line.and_then(|line| line.split_whitespace().next()?.parse::<u64>().ok()).map_or(0, |kib| kib / 1024)
}
