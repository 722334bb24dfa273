//! What only a process of its own can show: kills, exit codes, pipes, and the command without a display.

#![expect(clippy::unwrap_used, reason = "a panic is how a test fails")]

use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::time::{Duration, Instant};

/// A closed room with a lamp, as a glTF file with its buffer inside.
const ROOM: &str = include_str!("room.gltf");

fn clerestory(folder: &Path) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_clerestory"));
    command.current_dir(folder).stdin(Stdio::null()).env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    command
}

fn desk() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("room.gltf"), ROOM).unwrap();
    folder
}

fn run(folder: &Path, line: &str) -> Output {
    clerestory(folder).args(line.split_whitespace()).output().unwrap()
}

#[track_caller]
fn succeeds(folder: &Path, line: &str) -> Output {
    let output = run(folder, line);
    assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    output
}

const BAKE: &str = "bake room.gltf --size 160x120 --spp 96 --threads 1 -o";

#[test]
fn a_killed_bake_is_taken_up_and_ends_with_the_same_bytes() {
    let folder = desk();
    let (part, whole) = (folder.path().join("b.transport.part"), folder.path().join("b.transport"));
    succeeds(folder.path(), &format!("{BAKE} a.transport"));
    let reference = std::fs::read(folder.path().join("a.transport")).unwrap();

    let mut child = clerestory(folder.path()).args(format!("{BAKE} b.transport").split_whitespace()).spawn().unwrap();
    // Killed once something worth keeping was written.
    let deadline = Instant::now() + Duration::from_secs(60);
    while std::fs::metadata(&part).map_or(0, |m| m.len()) < 20_000 && !whole.exists() {
        assert!(Instant::now() < deadline, "nothing was written in a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(!whole.exists(), "the bake ended before it could be killed: make it longer");
    assert!(part.exists(), "a killed bake keeps what was done");

    succeeds(folder.path(), &format!("{BAKE} b.transport"));
    assert!(std::fs::read(&whole).unwrap() == reference, "an interrupted bake has other bytes");
    assert!(!part.exists(), "the half-done file stays behind");
}

/// Greatest resident set of a command that succeeds, bytes, and what it says; 0 where the system does not tell.
fn peak_of(folder: &Path, line: &str) -> (u64, String) {
    let command = clerestory(folder).args(line.split_whitespace()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let (mut child, mut peak) = (command.unwrap(), 0);
    while child.try_wait().unwrap().is_none() {
        peak = clerestory::platform::peak_bytes_of(child.id()).unwrap_or(0).max(peak);
        std::thread::sleep(Duration::from_millis(1));
    }
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{line}: {said}");
    (peak, said)
}

#[test]
fn a_limit_of_memory_is_kept_by_fewer_threads_and_changes_no_byte() {
    let folder = desk();
    const MANY_COLUMNS: &str = "bake room.gltf --size 96x64 --spp 4 --sky uniform --sky-patches 2305 --threads 8 -o";
    let (without, _) = peak_of(folder.path(), &format!("{MANY_COLUMNS} a.transport"));
    let (within, said) = peak_of(folder.path(), &format!("{MANY_COLUMNS} b.transport --memory 170MB"));
    assert!(said.contains("of 8 threads bake"), "{said}");
    let [a, b] = ["a", "b"].map(|name| std::fs::read(folder.path().join(format!("{name}.transport"))).unwrap());
    assert!(a == b, "fewer threads bake other bytes");
    if without > 0 {
        assert!(without > 170_000_000, "{without} bytes are within the limit anyway: make the bake larger");
        assert!(within <= 170_000_000, "{within} bytes");
    }
    let refused = run(folder.path(), &format!("{MANY_COLUMNS} c.transport --memory 30MB"));
    let said = String::from_utf8_lossy(&refused.stderr).into_owned();
    assert!(refused.status.code() == Some(1) && said.contains("on a single thread"), "{said}");
}

#[test]
fn a_cut_off_part_file_does_no_harm_and_fresh_starts_over() {
    let folder = desk();
    const SMALL: &str = "bake room.gltf --size 40x30 --spp 8 -o";
    succeeds(folder.path(), &format!("{SMALL} a.transport"));
    let reference = std::fs::read(folder.path().join("a.transport")).unwrap();
    std::fs::write(folder.path().join("b.transport.part"), b"not a bake at all").unwrap();
    succeeds(folder.path(), &format!("{SMALL} b.transport --fresh"));
    assert!(std::fs::read(folder.path().join("b.transport")).unwrap() == reference);
}

#[test]
fn exit_codes_tell_success_failure_and_wrong_usage_apart() {
    let folder = desk();
    for (line, code) in [
        ("--help", 0),
        ("--version", 0),
        ("info room.gltf", 0),
        ("info none.glb", 1),
        ("none.glb", 1),
        ("info", 2),
        ("bake room.gltf", 2),
        ("bake room.gltf -o a.transport --spp none", 2),
        ("trace room.gltf -o a.exr --nonsense", 2),
    ] {
        let output = run(folder.path(), line);
        assert_eq!(output.status.code(), Some(code), "{line}: {}", String::from_utf8_lossy(&output.stderr));
        assert_eq!(output.stdout.is_empty(), code != 0, "{line}");
        assert_eq!(output.stderr.is_empty(), code == 0, "{line}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn files_that_are_no_scenes_fail_with_words() {
    let folder = desk();
    let files: [(&str, &[u8]); 6] = [
        ("empty.glb", b""),
        ("text.glb", b"hello"),
        ("short.glb", b"glTF\x02\0\0\0\xff\xff\0\0"),
        ("broken.gltf", b"{\"asset\": "),
        ("list.gltf", b"[1, 2, 3]"),
        ("old.gltf", b"{\"asset\": {\"version\": \"1.0\"}}"),
    ];
    for (name, bytes) in files {
        std::fs::write(folder.path().join(name), bytes).unwrap();
        let output = run(folder.path(), &format!("info {name}"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{name}: {said}");
        assert!(said.starts_with("error: ") && said.contains(name) && !said.contains("panicked"), "{name}: {said}");
    }
}

#[test]
fn a_reader_that_leaves_early_is_no_error() {
    let folder = desk();
    let mut child = clerestory(folder.path()).args(["info", "room.gltf"]).stdout(Stdio::piped()).spawn().unwrap();
    drop(child.stdout.take());
    assert!(child.wait().unwrap().success());
}

#[test]
fn nothing_but_the_answer_is_written_to_a_pipe() {
    let folder = desk();
    let output = succeeds(folder.path(), "trace room.gltf -o a.exr --size 16x12 --spp 2 --json");
    let lines = String::from_utf8(output.stdout).unwrap();
    assert_eq!(lines.lines().count(), 1, "{lines}");
    assert!(!String::from_utf8_lossy(&output.stderr).contains("tracing"), "a pipe has no progress bar");
}

#[test]
fn where_there_is_no_graphics_hardware_nobody_complains() {
    if ["/dev/dri", "/dev/nvidiactl", "/dev/dxg"].iter().any(|node| Path::new(node).exists()) {
        println!("skipped: there is graphics hardware");
        return;
    }
    let folder = desk();
    succeeds(folder.path(), "bake room.gltf -o a.transport --size 16x12 --spp 2");
    let mut relight = clerestory(folder.path());
    relight.env_remove("XDG_RUNTIME_DIR").args(["relight", "a.transport", "-o", "a.exr"]);
    let output = relight.output().unwrap();
    assert!(output.status.success());
    assert_eq!(String::from_utf8_lossy(&output.stderr), "");
}

#[test]
fn without_a_display_three_looks_become_frames() {
    let folder = desk();
    let output = succeeds(folder.path(), "room.gltf");
    let said = String::from_utf8(output.stdout).unwrap();
    let frames = std::fs::read_dir(folder.path().join("frames")).unwrap();
    let names: Vec<String> = frames.map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    for extension in [".png", ".exr"] {
        assert_eq!(names.iter().filter(|name| name.ends_with(extension)).count(), 3, "{names:?}");
    }
    assert!(said.contains("frames/") && said.contains("display"), "{said}");
}

#[test]
fn without_a_display_a_bake_is_not_baked_again_but_told_how_it_is_lit() {
    let folder = desk();
    std::fs::write(folder.path().join("room.transport"), "").unwrap();
    let output = run(folder.path(), "room.transport");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(
        output.status.code() == Some(1) && said.contains("`clerestory relight room.transport -o OUT.png`"),
        "{said}"
    );
    assert!(!said.contains("baking") && !folder.path().join("frames").exists(), "{said}");
}

#[test]
fn without_a_display_frames_that_are_black_are_told() {
    let folder = desk();
    let mut room: serde_json::Value = serde_json::from_str(ROOM).unwrap();
    // The lamp hangs outside of the closed room.
    room["nodes"][1]["translation"] = serde_json::json!([9, 9, 9]);
    std::fs::write(folder.path().join("dark.gltf"), room.to_string()).unwrap();
    let told = answer(folder.path(), "dark.gltf")["warnings"].to_string();
    assert!(told.contains("the picture of as-designed is black"), "{told}");
}

#[test]
fn without_a_display_pictures_are_told_of_as_bake_tells_and_keep_their_places() {
    let folder = desk();
    std::fs::create_dir(folder.path().join("stage")).unwrap();
    for name in ["a", "b"] {
        let picture = image::RgbImage::from_pixel(16, 12, image::Rgb([188; 3]));
        picture.save(folder.path().join(format!("stage/{name}.png"))).unwrap();
    }
    let told = answer(folder.path(), "stage")["warnings"].to_string();
    assert!(told.contains("2 of 2 pictures are PNG or JPEG"), "{told}");
    // A picture that is cut off is found by who reads it.
    std::fs::create_dir_all(folder.path().join("cut/frames")).unwrap();
    let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 8 +X 16\n";
    std::fs::write(folder.path().join("cut/frames/warm.exr"), head).unwrap();
    let output = run(&folder.path().join("cut"), "frames");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("would overwrite the picture"), "{said}");
}

/// Elsewhere nothing says where the state of the window is.
#[cfg(target_os = "linux")]
#[test]
fn without_a_display_a_look_lights_the_scene_that_was_open_last() {
    let folder = desk();
    let lit = |intensity: f32| serde_json::json!({"lamp": {"intensity": intensity}});
    let spare = serde_json::json!({"key": "spare", "type": "point", "position": [0, 0, 0], "strength": 3});
    let dark = serde_json::json!({"lamp": {"muted": true}});
    let look = serde_json::json!({"clerestory": 1, "lights": lit(2.0), "looks": [
        {"name": "Half / dim", "lights": lit(0.5)}, {"name": "Spare", "lights": dark, "lamps": [spare]},
    ]});
    std::fs::write(folder.path().join("evening.look"), look.to_string()).unwrap();
    std::fs::create_dir_all(folder.path().join("state/clerestory")).unwrap();
    let run_after = |recent: &[&str]| {
        let recent: Vec<_> = recent.iter().map(|name| folder.path().join(name)).collect();
        let state = serde_json::json!({"recent": serde_json::json!(recent).to_string()});
        std::fs::write(folder.path().join("state/clerestory/app.ron"), state.to_string()).unwrap();
        let mut command = clerestory(folder.path());
        command.env("XDG_DATA_HOME", folder.path().join("state")).args(["evening.look", "--json"]);
        command.output().unwrap()
    };
    let output = run_after(&["evening.look", "gone.gltf", "room.gltf"]);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let names: Vec<String> = names_in(&folder.path().join("frames"));
    let looks = ["Half - dim", "Spare", "evening"];
    assert_eq!(names, looks.map(|look| ["exr", "png"].map(|ending| format!("{look}.{ending}"))).concat());
    let told: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert!(told["warnings"].to_string().contains("where it falls"), "{}", told["warnings"]);
    let of_spare = clerestory::compare::read_part(&folder.path().join("frames/Spare.exr")).unwrap().0;
    assert!(of_spare.pixels.iter().any(|rgb| rgb[0] > 0.0), "the added lamp alone shines there");

    std::fs::write(folder.path().join("old.transport"), "").unwrap();
    let output = run_after(&["old.transport", "room.gltf"]);
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("old.transport --look "), "{said}");
    assert!(said.contains("evening.look -o OUT.png"), "{said}");
}

/// Some two dozen blocks.
const SHORT_BAKE: &str = "bake room.gltf --size 96x64 --spp 48 --threads 1 -o";

/// Starts a bake and waits until something worth keeping was written.
fn half_done(folder: &Path, name: &str) -> Child {
    let part = folder.join(format!("{name}.part"));
    let mut bake = clerestory(folder);
    bake.args(format!("{SHORT_BAKE} {name}").split_whitespace()).stdout(Stdio::null()).stderr(Stdio::piped());
    let child = bake.spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    while std::fs::metadata(&part).map_or(0, |m| m.len()) < 8_000 {
        assert!(Instant::now() < deadline, "nothing was written in a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    child
}

fn names_in(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<String> = entries.map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// Sends a signal. The end of a terminal comes twice at once, from the shell and from the kernel.
#[cfg(unix)]
fn signal(child: &Child, name: &str) {
    let kill = format!("kill {name} {}", child.id());
    let script = if name == "-HUP" { format!("{kill} && {kill}") } else { kill };
    assert!(Command::new("sh").args(["-c", &script]).status().unwrap().success());
}

/// Signals that end a command, and its exit codes then. What this process ignores, those that it starts ignore, too.
#[cfg(unix)]
fn signals() -> Vec<(&'static str, i32)> {
    let hangup = (clerestory::platform::ignores_hangups() == Some(false)).then_some(("-HUP", 129));
    [("-INT", 130), ("-TERM", 143)].into_iter().chain(hangup).collect()
}

#[cfg(unix)]
#[test]
fn an_interrupted_bake_keeps_what_is_done_and_says_so() {
    let folder = desk();
    succeeds(folder.path(), &format!("{SHORT_BAKE} a.transport"));
    let reference = std::fs::read(folder.path().join("a.transport")).unwrap();
    for (name, code) in signals() {
        let child = half_done(folder.path(), "b.transport");
        let begun = Instant::now();
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{name}: {said}");
        assert!(said.starts_with("stopped: ") && said.contains("the same command goes on"), "{name}: {said}");
        assert!(begun.elapsed() < Duration::from_secs(20), "{name} took {:?}", begun.elapsed());
        assert_eq!(names_in(folder.path()), ["a.transport", "b.transport.part", "room.gltf"]);
        succeeds(folder.path(), &format!("{SHORT_BAKE} b.transport"));
        assert!(std::fs::read(folder.path().join("b.transport")).unwrap() == reference, "{name}: other bytes");
        std::fs::remove_file(folder.path().join("b.transport")).unwrap();
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_render_or_trace_leaves_nothing_behind() {
    let folder = desk();
    for command in ["render", "trace"] {
        let line = format!("{command} room.gltf -o a.png --size 640x480 --spp 4096");
        let child = clerestory(folder.path()).args(line.split(' ')).stderr(Stdio::piped()).spawn().unwrap();
        // From its first file on it heeds signals.
        let deadline = Instant::now() + Duration::from_secs(60);
        while names_in(folder.path()).len() < 2 {
            assert!(Instant::now() < deadline, "nothing was begun in a minute");
            std::thread::sleep(Duration::from_millis(2));
        }
        signal(&child, "-INT");
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(130), "{command}: {said}");
        assert_eq!(said, "stopped: nothing was written\n", "{command}");
    }
    assert_eq!(names_in(folder.path()), ["room.gltf"]);
}

#[test]
fn options_that_have_nothing_to_do_are_not_passed_over() {
    let folder = desk();
    for (line, words) in [
        ("info . --variant a", "--variant is for scenes"),
        ("info . --block-errors --json", "--block-errors is for transports"),
        ("relight room.transport -o a.exr --layers none,lights", "`none` or others"),
    ] {
        let output = run(folder.path(), line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{line}: {said}");
        assert!(said.contains(words), "{line}: {said}");
    }
    let mut dark: serde_json::Value = serde_json::from_str(ROOM).unwrap();
    dark["nodes"][1].as_object_mut().unwrap().remove("extensions");
    std::fs::write(folder.path().join("dark.gltf"), dark.to_string()).unwrap();
    let output = run(folder.path(), "export-gltf dark.gltf --unitless -o lit.glb");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("--unitless changes nothing"), "{said}");
    std::fs::write(folder.path().join("watts.look"), r#"{"clerestory": 1, "scene": {"units": "unitless"}}"#).unwrap();
    let output = run(folder.path(), "schedule dark.gltf --look watts.look -o lamps.csv");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("as the look does, changes nothing"), "{said}");
    let profile = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 2 1 1 2 0 0 0\n1 1 50\n0 90\n0\n100 0\n";
    std::fs::write(folder.path().join("a.ies"), profile).unwrap();
    let warnings = |line: &str| {
        let traced = format!("trace room.gltf --size 8x6 --spp 1 --unitless {line} -o a.exr");
        answer(folder.path(), &traced)["warnings"].to_string()
    };
    assert!(warnings("--ies lamp=a.ies").contains("--unitless changes nothing"));
    assert!(!warnings("").contains("--unitless changes nothing"));
}

#[test]
fn no_command_writes_to_stdout_or_to_a_file_of_that_sign() {
    let folder = desk();
    for line in ["bake room.gltf -o - --size 8x6 --spp 1", "schedule room.gltf -o -"] {
        let output = run(folder.path(), line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{line}: {said}");
        assert!(said.contains("cannot write to stdout"), "{line}: {said}");
        assert_eq!(names_in(folder.path()), ["room.gltf"], "{line}");
    }
}

#[cfg(unix)]
#[test]
fn an_interrupted_relight_leaves_nothing_behind() {
    let folder = desk();
    succeeds(folder.path(), "bake room.gltf --size 64x48 --spp 4 -o room.transport");
    let lit =
        r#"{"clerestory": 1, "lamps": [{"key": "bulb", "type": "point", "position": [0, 0.2, 0], "strength": 40}]}"#;
    std::fs::write(folder.path().join("lit.look"), lit).unwrap();
    let before = names_in(folder.path());
    for (name, code) in signals() {
        let line =
            "relight room.transport --look lit.look --scene room.gltf --lamp-samples 65536 --device cpu -o a.png";
        let child = clerestory(folder.path()).args(line.split(' ')).stderr(Stdio::piped()).spawn().unwrap();
        let deadline = Instant::now() + Duration::from_secs(60);
        while names_in(folder.path()).len() == before.len() {
            assert!(Instant::now() < deadline, "nothing was begun in a minute");
            std::thread::sleep(Duration::from_millis(2));
        }
        signal(&child, name);
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(code), "{name}: {said}");
        assert!(said.ends_with("stopped: nothing was written\n"), "{name}: {said}");
        assert_eq!(names_in(folder.path()), before, "{name}");
    }
}

/// Waits until a process reads a pipe, which stays open and empty then.
#[cfg(unix)]
fn read_by_now(pipe: &Path) -> std::fs::File {
    use std::os::unix::fs::OpenOptionsExt;
    let deadline = Instant::now() + Duration::from_secs(60);
    loop {
        match std::fs::OpenOptions::new().write(true).custom_flags(libc::O_NONBLOCK).open(pipe) {
            Ok(held) => return held,
            Err(error) => assert!(Instant::now() < deadline, "nobody reads {}: {error}", pipe.display()),
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[cfg(unix)]
#[test]
fn signals_are_heeded_while_files_are_read() {
    let folder = desk();
    let look = r#"{"clerestory": 1, "looks": [{"name": "Day"}], "timeline": {"keys": [{"time": 0, "look": "Day"}]}}"#;
    std::fs::write(folder.path().join("a.look"), look).unwrap();
    for pipe in ["pipe.transport", "pipe.look"] {
        assert!(Command::new("mkfifo").arg(folder.path().join(pipe)).status().unwrap().success());
    }
    let before = names_in(folder.path());
    for (line, pipe) in [
        ("relight pipe.transport --look a.look --device cpu -o f_#.exr", "pipe.transport"),
        ("render room.gltf --look pipe.look --device cpu --size 8x6 -o a.png", "pipe.look"),
        ("trace room.gltf --look pipe.look --size 8x6 -o a.png", "pipe.look"),
    ] {
        let mut child = clerestory(folder.path()).args(line.split(' ')).stderr(Stdio::piped()).spawn().unwrap();
        let held = read_by_now(&folder.path().join(pipe));
        signal(&child, "-INT");
        let deadline = Instant::now() + Duration::from_secs(60);
        while child.try_wait().unwrap().is_none() {
            if Instant::now() > deadline {
                child.kill().unwrap();
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(130), "{line}: {said}");
        assert_eq!(said, "stopped: nothing was written\n", "{line}");
        assert_eq!(names_in(folder.path()), before, "{line}");
        drop(held);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn what_ignores_the_end_of_its_terminal_goes_on() {
    let folder = desk();
    let script = format!("trap '' HUP; exec \"$0\" {SHORT_BAKE} b.transport");
    let mut bake = Command::new("sh");
    bake.current_dir(folder.path()).args(["-c", &script, env!("CARGO_BIN_EXE_clerestory")]);
    let child = bake.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    while std::fs::metadata(folder.path().join("b.transport.part")).map_or(0, |m| m.len()) < 8_000 {
        assert!(Instant::now() < deadline, "nothing was written in a minute");
        std::thread::sleep(Duration::from_millis(2));
    }
    signal(&child, "-HUP");
    let output = child.wait_with_output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}

#[test]
fn two_bakes_to_one_file_do_not_disturb_each_other() {
    let folder = desk();
    succeeds(folder.path(), &format!("{SHORT_BAKE} a.transport"));
    let first = half_done(folder.path(), "b.transport");
    for more in ["", " --fresh"] {
        let second = run(folder.path(), &format!("{SHORT_BAKE} b.transport{more}"));
        let said = String::from_utf8_lossy(&second.stderr).into_owned();
        assert_eq!(second.status.code(), Some(1), "{said}");
        assert!(said.contains("is being written by another bake"), "{said}");
    }
    assert!(first.wait_with_output().unwrap().status.success());
    let read = |name: &str| std::fs::read(folder.path().join(name)).unwrap();
    assert!(read("a.transport") == read("b.transport"));
    assert_eq!(names_in(folder.path()), ["a.transport", "b.transport", "room.gltf"]);
}

#[cfg(unix)]
#[test]
fn a_disk_that_fills_up_costs_nothing_but_time() {
    let folder = desk();
    succeeds(folder.path(), &format!("{SHORT_BAKE} a.transport"));
    let reference = std::fs::read(folder.path().join("a.transport")).unwrap();
    std::fs::write(folder.path().join("b.transport"), b"the old file").unwrap();
    // Files may not grow beyond 16 blocks of 512 bytes (1024 in some shells).
    let script = format!("ulimit -f 16; exec \"$0\" {SHORT_BAKE} b.transport");
    let mut limited = Command::new("sh");
    limited.current_dir(folder.path()).args(["-c", &script, env!("CARGO_BIN_EXE_clerestory")]);
    let output = limited.stdin(Stdio::null()).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("b.transport.part") && said.contains("run the same command again"), "{said}");
    assert_eq!(std::fs::read(folder.path().join("b.transport")).unwrap(), b"the old file");
    assert_eq!(names_in(folder.path()), ["a.transport", "b.transport", "b.transport.part", "room.gltf"]);
    succeeds(folder.path(), &format!("{SHORT_BAKE} b.transport"));
    assert!(std::fs::read(folder.path().join("b.transport")).unwrap() == reference);
}

#[cfg(unix)]
#[test]
fn a_disk_without_room_keeps_every_kind_of_old_file() {
    let folder = desk();
    succeeds(folder.path(), "bake room.gltf --size 32x24 --spp 4 --irradiance --work-plane 0.5:0.4 -o room.transport");
    let (wishes, look) = (
        r#"{"wishes": [{"sensors": "work plane 0.5 m", "times": 2}]}"#,
        r#"{"clerestory": 1, "lights": {"lamp": {"intensity": 0.5}}}"#,
    );
    std::fs::write(folder.path().join("wishes.json"), wishes).unwrap();
    std::fs::write(folder.path().join("dim.look"), look).unwrap();
    let commands = [
        "relight room.transport -o old.exr --layers lights",
        "relight room.transport -o old.png --bits 16",
        "relight room.transport --contact-sheet dim.look dim.look -o old.png",
        "trace room.gltf --size 32x24 --spp 1 -o old.exr",
        "render room.gltf --size 32x24 --spp 1 -o old.exr",
        "sensors room.transport -o old.csv",
        "solve room.transport --wishes wishes.json -o old.look",
        "schedule room.gltf -o old.csv",
        "export-gltf room.gltf --look dim.look -o old.glb",
    ];
    for name in ["old.exr", "old.png", "old.csv", "old.look", "old.glb"] {
        std::fs::write(folder.path().join(name), b"the old file").unwrap();
    }
    let before = names_in(folder.path());
    for line in commands {
        // No file may grow at all.
        let script = format!("ulimit -f 0; exec \"$0\" {line}");
        let mut limited = Command::new("sh");
        limited.current_dir(folder.path()).args(["-c", &script, env!("CARGO_BIN_EXE_clerestory")]);
        let output = limited.stdin(Stdio::null()).output().unwrap();
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{line}: {said}");
        let name = line.split("-o ").nth(1).unwrap().split(' ').next().unwrap();
        assert!(said.contains(&format!("cannot write {name}: check that there is room on the disk")), "{line}: {said}");
        assert_eq!(std::fs::read(folder.path().join(name)).unwrap(), b"the old file", "{line}");
        assert_eq!(names_in(folder.path()), before, "{line}");
        succeeds(folder.path(), line);
        std::fs::write(folder.path().join(name), b"the old file").unwrap();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_folder_that_cannot_be_written_is_found_out_at_once() {
    let folder = desk();
    for output in ["/proc/a.transport", "/dev/full/a.transport", "none/a.transport"] {
        let begun = Instant::now();
        let refused = run(folder.path(), &format!("{SHORT_BAKE} {output}"));
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{said}");
        assert!(said.starts_with("error: cannot write") && said.contains(output), "{said}");
        assert!(begun.elapsed() < Duration::from_secs(10), "{output} was tried after the long work");
    }
}

#[cfg(unix)]
#[test]
fn a_folder_that_vanishes_is_an_error_in_words() {
    let folder = desk();
    std::fs::create_dir(folder.path().join("sub")).unwrap();
    let child = half_done(folder.path(), "sub/b.transport");
    std::fs::remove_dir_all(folder.path().join("sub")).unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("cannot create") && said.contains("sub/b.transport"), "{said}");
}

#[test]
fn a_scene_never_makes_the_program_read_elsewhere() {
    let folder = desk();
    let inside = folder.path().join("scene");
    std::fs::create_dir(&inside).unwrap();
    std::fs::write(folder.path().join("secret.bin"), [0; 360]).unwrap();
    for uri in ["../secret.bin", "%2e%2e/secret.bin", "/etc/hostname", "http://localhost/a.bin"] {
        let start = ROOM.find("data:application").unwrap();
        let end = start + ROOM[start..].find('"').unwrap();
        std::fs::write(inside.join("a.gltf"), format!("{}{uri}{}", &ROOM[..start], &ROOM[end..])).unwrap();
        let refused = run(&inside, "info a.gltf");
        let said = String::from_utf8_lossy(&refused.stderr).into_owned();
        assert_eq!(refused.status.code(), Some(1), "{uri}: {said}");
        assert!(said.contains("does not lie beside the glTF file"), "{uri}: {said}");
    }
}

/// What a command answers with `--json`.
fn answer(folder: &Path, line: &str) -> serde_json::Value {
    serde_json::from_slice(&succeeds(folder, &format!("{line} --json")).stdout).unwrap()
}

#[test]
fn the_time_of_a_preview_is_told_where_there_is_one() {
    let folder = desk();
    for (line, has_preview) in [
        ("bake room.gltf --size 16x12 --spp 2 -o a.transport", true),
        ("render room.gltf --size 16x12 --spp 2 -o a.png", false),
        ("render room.gltf --size 16x12 --spp 2 --seconds 1 -o a.png", true),
    ] {
        let told = answer(folder.path(), line)["preview_secs"].clone();
        assert_eq!((told.is_number(), told.is_null()), (has_preview, !has_preview), "{line}: {told}");
    }
}

#[test]
fn the_error_of_every_block_is_listed_in_its_layers() {
    let folder = desk();
    succeeds(folder.path(), "bake room.gltf --size 40x24 --spp 8 -o a.transport");
    assert!(answer(folder.path(), "info a.transport").get("block_errors").is_none());
    let told = answer(folder.path(), "info a.transport --block-errors");
    let (errors, spread) = (&told["block_errors"], &told["block_error_db"]);
    assert!(errors["width"] == 3 && errors["height"] == 2, "{errors}");
    for layer in ["truncation", "sampling", "noise", "total"] {
        let blocks = errors[layer].as_array().unwrap().iter().map(|db| db.as_f64().unwrap());
        let worst = blocks.clone().fold(f64::INFINITY, f64::min);
        assert!(blocks.count() == 6 && spread[layer]["worst"].as_f64() == Some(worst), "{layer}: {errors}, {spread}");
    }
    let output = run(folder.path(), "info room.gltf --block-errors --json");
    assert!(!output.status.success() && String::from_utf8_lossy(&output.stderr).contains("is for transports"));
}

#[test]
fn the_lights_with_the_worst_columns_are_named_by_bake_and_info() {
    let folder = desk();
    let told = answer(folder.path(), "bake room.gltf --size 40x24 --spp 8 -o a.transport")["column_error_db"].clone();
    let worst = told["worst"].as_array().unwrap();
    let db = |value: &serde_json::Value| value.as_f64().unwrap();
    assert!(
        worst.is_sorted_by(|a, b| db(&a["db"]) <= db(&b["db"])) && db(&worst[0]["db"]) <= db(&told["tenth"]),
        "{told}"
    );
    assert!(db(&told["tenth"]) <= db(&told["median"]), "{told}");
    assert_eq!(answer(folder.path(), "info a.transport")["column_error_db"], told);
    let said = String::from_utf8(succeeds(folder.path(), "info a.transport").stdout).unwrap();
    let first = worst[0]["light"].as_str().unwrap();
    assert!(said.contains(&format!("worst light {first} {:.1} dB", db(&worst[0]["db"]))), "{said}");
    // Other methods tell nothing of columns.
    let of_other = answer(folder.path(), "bake room.gltf --size 40x24 --spp 8 --method svd -o b.transport");
    assert!(of_other.get("column_error_db").is_none(), "{of_other}");
}

#[test]
fn a_method_that_cannot_relight_is_baked_in_full_and_everything_says_so() {
    let folder = desk();
    for method in ["kernel", "compressed-sensing"] {
        let bake = format!("bake room.gltf --size 32x24 --spp 8 --tolerance 20 --method {method}");
        let baked = format!("{bake} --fresh -o a.transport");
        for line in [&baked, &format!("{bake} --estimate"), "info a.transport"] {
            let said = String::from_utf8(succeeds(folder.path(), line).stdout).unwrap();
            assert!(said.contains(method) && said.contains("holds its reconstruction in full"), "{line}: {said}");
            let told = &answer(folder.path(), line)["reconstruction"];
            assert!(told["method"] == method && told["why"].is_string(), "{line}: {told}");
        }
        succeeds(folder.path(), "relight a.transport -o a.exr");
    }
}

#[test]
fn wishes_become_a_look_that_meets_them_and_bad_ones_fail_with_words() {
    let folder = desk();
    let path = |name: &str| folder.path().join(name);
    succeeds(folder.path(), "bake room.gltf --size 32x24 --spp 16 --irradiance --work-plane 0.5:0.4 -o room.transport");
    let lux = |look: &str| {
        answer(folder.path(), &format!("sensors room.transport {look}"))["grids"][0]["average_lux"].as_f64().unwrap()
    };
    let wanted = 3.0 * lux("");
    let wishes = format!(
        r#"{{"wishes": [{{"name": "plane", "sensors": "work plane 0.5 m", "lux": {wanted}}}], "factor": [0, 50]}}"#
    );
    std::fs::write(path("wishes.json"), wishes).unwrap();
    let solved = answer(folder.path(), "solve room.transport --wishes wishes.json -o solved.look");
    assert_eq!(solved["wishes"][0]["met"], true, "{solved}");
    assert_eq!(solved["wishes"][0]["unit"], "lx", "{solved}");
    let reached = lux("--look solved.look");
    assert!((reached / wanted - 1.0).abs() < 0.02, "{reached} lx of {wanted}");
    // The picture of that look, matched from the scene's own light, gives the look back.
    succeeds(folder.path(), "relight room.transport --look solved.look -o wanted.exr");
    let matched = answer(folder.path(), "solve room.transport --match wanted.exr -o matched.look");
    let found = matched["lights"][0]["after"].as_f64().unwrap();
    assert!((found - 3.0).abs() < 0.1, "{matched}");
    let named = r#"{"wishes": [{"surface": "room", "times": 2}]}"#;
    std::fs::write(path("named.json"), named).unwrap();
    let solved = answer(folder.path(), "solve room.transport --wishes named.json --scene room.gltf -o named.look");
    assert!((solved["lights"][0]["after"].as_f64().unwrap() - 2.0).abs() < 0.01, "{solved}");
    // The look is for that scene, and stays so.
    for _ in 0..2 {
        let written = std::fs::read_to_string(path("named.look")).unwrap();
        assert!(written.contains(r#""scene_file": "room.gltf""#), "{written}");
        answer(folder.path(), "solve room.transport --look named.look --wishes wishes.json -o named.look");
    }
    for (json, words) in [
        (r#"{"wishes": []}"#, "nothing to solve for"),
        (r#"{"wishes": [{"lux": 5, "times": 2}]}"#, "give one of `lux`"),
        (r#"{"wishes": [{"surface": "room", "times": 2}]}"#, "--scene"),
        (r#"{"wishes": [{"rect": [90, 90, 99, 99], "lux": 2}]}"#, "holds no pixel"),
        (r#"{"wishes": [{"sensors": "desk", "lux": 2}]}"#, "work plane 0.5 m"),
        (r#"{"wishes": [{"lux": 2, "wieght": 2}]}"#, "wieght"),
        (r#"{"wishes": [{"lux": -2}]}"#, "`lux` must be"),
    ] {
        std::fs::write(path("bad.json"), json).unwrap();
        let output = run(folder.path(), "solve room.transport --wishes bad.json -o bad.look");
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{json}: {said}");
        assert!(said.contains(words) && !path("bad.look").exists(), "{json}: {said}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn wishes_and_looks_may_come_out_of_a_pipe() {
    let folder = desk();
    succeeds(folder.path(), "bake room.gltf --size 16x12 --spp 4 -o room.transport");
    std::fs::write(folder.path().join("w.json"), r#"{"wishes": [{"times": 2}]}"#).unwrap();
    for (file, line) in [
        ("w.json", "solve room.transport --wishes /dev/stdin -o a.look"),
        ("a.look", "solve room.transport --wishes w.json --look /dev/stdin -o b.look"),
        ("b.look", "relight room.transport --look /dev/stdin --device cpu -o a.png"),
    ] {
        let script = format!("cat {file} | \"$0\" {line}");
        let mut piped = Command::new("sh");
        piped.current_dir(folder.path()).args(["-c", &script, env!("CARGO_BIN_EXE_clerestory")]);
        let output = piped.output().unwrap();
        assert!(output.status.success(), "{line}: {}", String::from_utf8_lossy(&output.stderr));
    }
}

#[test]
fn the_work_plane_of_a_look_is_baked_with_the_illuminance_unless_another_one_is_named() {
    let folder = desk();
    let look = |floor: &str| {
        let look =
            format!(r#"{{"clerestory": 1, "scene": {{"work_plane": {{"height_m": 0.5, "spacing_m": 0.4{floor}}}}}}}"#);
        std::fs::write(folder.path().join("plane.look"), look).unwrap();
    };
    let grids = |options: &str| -> Vec<String> {
        let bake = "bake room.gltf --size 32x24 --spp 4 --fresh --look plane.look -o a.transport";
        succeeds(folder.path(), &format!("{bake} {options}"));
        let sets = answer(folder.path(), "info a.transport")["irradiance"].as_array().cloned().unwrap_or_default();
        sets.iter().map(|set| set["name"].as_str().unwrap().to_owned()).collect()
    };
    look("");
    assert_eq!(grids("--irradiance"), ["pixels", "work plane 0.5 m"]);
    assert_eq!(grids("--irradiance --work-plane 0.7"), ["pixels", "work plane 0.7 m"]);
    assert!(grids("").is_empty());
    look(r#", "floor": "room""#);
    assert_eq!(grids("--irradiance"), ["pixels", "work plane 0.5 m over room"]);
    look(r#", "floor": "garden""#);
    let bake = "bake room.gltf --size 32x24 --spp 4 --fresh --look plane.look -o a.transport --irradiance";
    assert!(answer(folder.path(), bake)["warnings"].to_string().contains("`garden`"));
}

#[test]
fn what_is_wished_in_a_look_is_solved_where_nothing_else_is_named() {
    let folder = desk();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("looks")).unwrap();
    succeeds(folder.path(), "bake room.gltf --size 32x24 --spp 16 --work-plane 0.5:0.4 -o room.transport");
    succeeds(folder.path(), "relight room.transport -o looks/as-it-is.exr");
    let marks = r#"{"film": [64, 48], "runs": [1000, 40]}"#;
    let look = format!(
        r#"{{"clerestory": 1, "wishes": {{"factor": [0, 50], "list": [
            {{"name": "plane", "sensors": "work plane 0.5 m", "times": 3}},
            {{"name": "wall", "marks": {marks}, "times": 3}},
            {{"name": "picture", "match": "as-it-is.exr", "exposure": -1.5849625, "weight": 0.5}},
            {{"name": "desk", "sensors": "desk", "lux": 500}}]}}}}"#
    );
    std::fs::write(path("looks/wished.look"), look).unwrap();
    let solved = answer(folder.path(), "solve room.transport --look looks/wished.look -o solved.look");
    let names: Vec<_> = solved["wishes"].as_array().unwrap().iter().map(|wish| wish["name"].clone()).collect();
    assert_eq!(names, ["plane", "wall", "picture"], "{solved}");
    assert!(solved["wishes"].as_array().unwrap().iter().all(|wish| wish["met"] == true), "{solved}");
    assert!((solved["lights"][0]["after"].as_f64().unwrap() - 3.0).abs() < 0.1, "{solved}");
    assert!(solved["warnings"].to_string().contains("`desk` is left out: This bake has no sensors desk"), "{solved}");
    // The wishes are still there, and what they name is found from where the look lies now.
    let written = std::fs::read_to_string(path("solved.look")).unwrap();
    assert!(written.contains("looks/as-it-is.exr") && written.contains("work plane 0.5 m"), "{written}");
    answer(folder.path(), "solve room.transport --look solved.look -o again.look");
    // Its own earlier answer is no file of another kind, whatever it is called; wishes are.
    for _ in 0..2 {
        answer(folder.path(), "solve room.transport --look solved.look -o best.json");
    }
    // What is named takes their place, and a look without any is nothing to solve for.
    std::fs::write(path("own.json"), r#"{"wishes": [{"times": 2}]}"#).unwrap();
    let output = run(folder.path(), "solve room.transport --look solved.look -o own.json");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(said.contains("own.json is there already and is no .look file"), "{said}");
    let own = answer(folder.path(), "solve room.transport --look solved.look --wishes own.json -o own.look");
    assert_eq!(own["wishes"].as_array().unwrap().len(), 1, "{own}");
    // Lamps of a look take part where the scene is named, which is no place for the answer.
    let lit =
        r#"{"clerestory": 1, "lamps": [{"key": "bulb", "type": "point", "position": [0, 0.2, 0], "strength": 40}]}"#;
    std::fs::write(path("lit.look"), lit).unwrap();
    let told = answer(folder.path(), "solve room.transport --look lit.look --wishes own.json -o own.look");
    assert!(told["warnings"].to_string().contains("name the scene with --scene"), "{told}");
    for command in ["solve room.transport --wishes own.json", "sensors room.transport"] {
        let output = run(folder.path(), &format!("{command} --scene room.gltf -o room.gltf"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains("would overwrite the scene"), "{command}: {said}");
        assert_eq!(std::fs::read_to_string(path("room.gltf")).unwrap(), ROOM);
    }
    std::fs::write(path("bare.look"), r#"{"clerestory": 1}"#).unwrap();
    let output = run(folder.path(), "solve room.transport --look bare.look -o bad.look");
    assert!(String::from_utf8_lossy(&output.stderr).contains("a --look with wishes"));
}

#[test]
fn no_output_takes_the_place_of_a_file_that_the_scene_or_the_wishes_name() {
    let folder = desk();
    let path = |name: &str| folder.path().join(name);
    let files = ["wood.png", "wood.exr", "wood.transport", "wood.glb", "wood.csv", "wood.look", "wood_1.png"];
    let mut scene: serde_json::Value = serde_json::from_str(ROOM).unwrap();
    scene["images"] = files.iter().map(|file| serde_json::json!({"uri": file})).collect();
    std::fs::write(path("named.gltf"), scene.to_string()).unwrap();
    files.iter().for_each(|file| std::fs::write(path(file), "grain").unwrap());
    let shots = r#"{"clerestory": 1, "looks": [{"name": "Day"}],
        "timeline": {"fps": 4, "keys": [{"time": 0, "look": "Day"}, {"time": 1, "look": "Day"}]}}"#;
    std::fs::write(path("shots.look"), shots).unwrap();
    std::fs::write(path("w.json"), r#"{"wishes": [{"match": "goal.exr"}]}"#).unwrap();
    std::fs::write(path("goal.exr"), "grain").unwrap();
    succeeds(folder.path(), "bake room.gltf --size 32x24 --spp 4 --work-plane 0.5:0.4 -o room.transport");
    let relight = "relight room.transport --device cpu --scene named.gltf";
    for line in [
        "bake named.gltf -o wood.transport --size 8x6 --spp 1",
        "render named.gltf -o wood.exr --size 8x6 --spp 1",
        "trace named.gltf -o wood.png --size 8x6 --spp 1",
        &format!("{relight} -o ./wood.png"),
        &format!("{relight} --contact-sheet shots.look -o wood.png"),
        &format!("{relight} --look shots.look -o wood_#.png"),
        "export-gltf named.gltf -o wood.glb",
        "schedule named.gltf -o wood.csv",
        "sensors room.transport --scene named.gltf -o wood.csv",
        "solve room.transport --scene named.gltf --wishes w.json -o wood.look",
        "solve room.transport --wishes w.json -o goal.exr",
    ] {
        let output = run(folder.path(), line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        let what = if line.contains("goal") { "picture" } else { "file of the scene" };
        assert_eq!(output.status.code(), Some(1), "{line}: {said}");
        assert!(said.contains(&format!("would overwrite the {what}")), "{line}: {said}");
    }
    for file in files.iter().chain(&["goal.exr"]) {
        assert_eq!(std::fs::read(path(file)).unwrap(), b"grain", "{file}");
    }
}

#[test]
fn an_output_takes_the_place_of_no_file_of_another_kind() {
    let folder = desk();
    let path = |name: &str| folder.path().join(name);
    std::fs::create_dir(path("stage")).unwrap();
    image::RgbImage::from_pixel(8, 6, image::Rgb([90, 80, 70])).save(path("stage/warm.png")).unwrap();
    std::fs::write(path("w.json"), r#"{"wishes": [{"times": 2}]}"#).unwrap();
    succeeds(folder.path(), "bake room.gltf --size 8x6 --spp 1 -o room.transport");
    let others = ["s.glb", "s.transport", "s.look", "p.exr", "p.JPG", "x.t"];
    others.iter().for_each(|name| std::fs::write(path(name), "old").unwrap());
    for (line, own) in [
        ("sensors room.transport -o s.glb", "csv"),
        ("schedule room.transport -o s.glb", "csv"),
        ("schedule room.gltf -o s.transport", "csv"),
        ("solve room.transport --wishes w.json -o s.glb", "look"),
        ("solve room.transport --wishes w.json -o p.JPG", "look"),
        ("bake room.gltf --size 8x6 --spp 1 -o p.exr", "transport"),
        ("bake room.gltf --size 8x6 --spp 1 -o s.look", "transport"),
        ("bake --images stage -o s.glb --fresh", "transport"),
    ] {
        let output = run(folder.path(), line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{line}: {said}");
        assert!(said.contains(&format!("is no .{own} file")), "{line}: {said}");
    }
    others.iter().for_each(|name| assert_eq!(std::fs::read(path(name)).unwrap(), b"old", "{name}"));
    succeeds(folder.path(), "schedule room.gltf -o x.t");
    assert_ne!(std::fs::read(path("x.t")).unwrap(), b"old");
}

#[test]
fn frames_without_a_display_take_the_place_of_no_picture_that_they_are_made_of() {
    let folder = desk();
    let frames = folder.path().join("frames");
    std::fs::create_dir(&frames).unwrap();
    image::RgbImage::from_pixel(8, 6, image::Rgb([90, 80, 70])).save(frames.join("warm.png")).unwrap();
    let before = std::fs::read(frames.join("warm.png")).unwrap();
    let output = run(folder.path(), "./frames");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(1), "{said}");
    assert!(said.contains("would overwrite the picture"), "{said}");
    assert_eq!(std::fs::read(frames.join("warm.png")).unwrap(), before);
}

#[test]
fn what_is_solved_takes_the_place_of_no_file_that_its_look_names() {
    let folder = desk();
    let looks = folder.path().join("looks");
    std::fs::create_dir(&looks).unwrap();
    let head = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 1 +X 2\n";
    let sky = [&head[..], &[32, 64, 128, 131, 32, 64, 128, 131]].concat();
    for (name, bytes) in [("day.hdr", sky.as_slice()), ("down.ies", &b"IESNA"[..]), ("goal.exr", &b"linear"[..])] {
        std::fs::write(looks.join(name), bytes).unwrap();
    }
    let look = r#"{"clerestory": 1, "sky": {"file": "day.hdr"}, "lamps": [{"key": "down", "type": "ies",
        "position": [0, 0.9, 0], "aim": [0, -1, 0], "strength": 300, "unit": "cd", "file": "down.ies"}],
        "wishes": {"list": [{"name": "goal", "match": "goal.exr"}]}}"#;
    std::fs::write(looks.join("a.look"), look).unwrap();
    for (name, what) in [("day.hdr", "sky"), ("down.ies", "measured distribution"), ("goal.exr", "picture")] {
        let before = std::fs::read(looks.join(name)).unwrap();
        let output = run(folder.path(), &format!("solve room.transport --look looks/a.look -o looks/{name}"));
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert!(said.contains(&format!("would overwrite the {what}")), "{said}");
        assert_eq!(std::fs::read(looks.join(name)).unwrap(), before);
    }
}

#[test]
fn no_picture_or_scene_takes_the_place_of_what_its_look_names() {
    let folder = desk();
    let path = |name: &str| folder.path().join(name);
    let look = r#"{"clerestory": 1, "scene_file": "old.glb", "looks": [{"name": "Day"}],
        "timeline": {"fps": 4, "keys": [{"time": 0, "look": "Day"}, {"time": 1, "look": "Day"}]},
        "wishes": {"list": [{"name": "goal", "match": "goal_1.png"}]}}"#;
    std::fs::write(path("a.look"), look).unwrap();
    ["goal_1.png", "old.glb"].iter().for_each(|name| std::fs::write(path(name), "old").unwrap());
    succeeds(folder.path(), "bake room.gltf --size 8x6 --spp 1 -o room.transport");
    for (line, what) in [
        ("relight room.transport --look a.look -o goal_1.png", "picture"),
        ("relight room.transport --look a.look -o goal_#.png", "picture"),
        ("render room.gltf --look a.look -o goal_1.png --size 8x6 --spp 1", "picture"),
        ("export-gltf room.gltf --look a.look -o old.glb", "scene"),
    ] {
        let output = run(folder.path(), line);
        let said = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{line}: {said}");
        assert!(said.contains(&format!("would overwrite the {what}")), "{line}: {said}");
    }
    ["goal_1.png", "old.glb"].iter().for_each(|name| assert_eq!(std::fs::read(path(name)).unwrap(), b"old", "{name}"));
    // A bake that the look was saved with is made anew under it.
    std::fs::write(path("a.look"), look.replace("old.glb", "room.transport")).unwrap();
    succeeds(folder.path(), "bake room.gltf --look a.look --size 8x6 --spp 1 -o room.transport");
}

#[test]
fn a_transport_is_told_by_its_first_bytes_whatever_it_is_called() {
    let folder = desk();
    succeeds(folder.path(), "bake room.gltf --size 8x6 --spp 1 -o room.t");
    std::fs::copy(folder.path().join("room.t"), folder.path().join("room.transport")).unwrap();
    let [told, usual] = ["room.t", "room.transport"]
        .map(|file| answer(folder.path(), &format!("schedule {file} -o {file}.csv"))["luminaires"].clone());
    assert!(!told.as_array().unwrap().is_empty());
    assert_eq!(told, usual);
    // So is an earlier bake that another one takes the place of.
    std::fs::rename(folder.path().join("room.t"), folder.path().join("room.bin")).unwrap();
    succeeds(folder.path(), "bake room.gltf --size 8x6 --spp 1 -o room.bin");
}

#[test]
fn a_schedule_counts_what_shines_and_measures_the_floor() {
    let folder = desk();
    let told = answer(folder.path(), "schedule room.gltf --efficacy 50 -o lamps.csv");
    // 3 cd all around, over a floor of 2 m × 2 m.
    let lumen = 12.0 * std::f64::consts::PI;
    let near = |name: &str, known: f64| {
        let found = told[name].as_f64().unwrap();
        assert!((found / known - 1.0).abs() < 1e-4, "{name}: {found} is not {known}");
    };
    near("lumen", lumen);
    near("watt", lumen / 50.0);
    near("floor_m2", 4.0);
    near("watt_per_m2", lumen / 200.0);
    let table = std::fs::read_to_string(folder.path().join("lamps.csv")).unwrap();
    assert!(
        table.lines().nth(1).unwrap().starts_with("lamp,lamp,Point lamp,1,yes,37.7,0.8,0.300,0.600,-0.200,"),
        "{table}"
    );
    let told = answer(folder.path(), "schedule room.gltf --by type -o types.csv");
    assert!(told["watt"] == 0.0 && told["n_unknown_watt"] == 1 && told["types"][0]["lamps"][0] == "lamp", "{told}");
    let table = std::fs::read_to_string(folder.path().join("types.csv")).unwrap();
    assert!(table.lines().nth(1).unwrap().starts_with("A,Point lamp,,1,yes,37.7,,37.7,,,"), "{table}");
    let refused = run(folder.path(), "schedule room.gltf -o room.gltf");
    assert!(String::from_utf8_lossy(&refused.stderr).contains("would overwrite"));
    // Units that the look chooses count as in a bake.
    std::fs::write(folder.path().join("watts.look"), r#"{"clerestory": 1, "scene": {"units": "unitless"}}"#).unwrap();
    let told = answer(folder.path(), "schedule room.gltf --look watts.look -o watts.csv");
    assert!((told["lumen"].as_f64().unwrap() / (683.0 * lumen) - 1.0).abs() < 1e-4, "{told}");
    // A photometric file lies beside its look.
    let looks = folder.path().join("looks");
    std::fs::create_dir(&looks).unwrap();
    let ies = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n";
    std::fs::write(looks.join("down.ies"), ies).unwrap();
    let look = r#"{"clerestory": 1, "lights": {"lamp": {"muted": true}}, "lamps": [{"key": "down", "type": "ies",
        "position": [0, 0.9, 0], "aim": [0, -1, 0], "strength": 300, "unit": "cd", "file": "down.ies"}]}"#;
    std::fs::write(looks.join("a.look"), look).unwrap();
    let told = answer(folder.path(), "schedule room.gltf --look looks/a.look -o measured.csv");
    assert!(told["watt"] == 10.0 && told["n_unknown_watt"] == 0, "{told}");
    assert!(told["lumen"].as_f64().unwrap() > 100.0, "{told}");
}

/// A screen without a window manager, which ends with it.
#[cfg(target_os = "linux")]
struct Screen {
    server: Child,
    name: String,
}

#[cfg(target_os = "linux")]
impl Screen {
    /// `None`, with a word, where there is no server for it; with `CLERESTORY_REQUIRE_GPU`, as checks set it, that is a failure.
    #[expect(clippy::print_stderr, reason = "a test that skips itself says so")]
    fn open() -> Option<Screen> {
        use std::io::BufRead;

        let arguments = ["-displayfd", "1", "-screen", "0", "1024x768x24", "-nolisten", "tcp"];
        let server = Command::new("Xvfb").args(arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn();
        let Ok(mut server) = server else {
            assert!(std::env::var_os("CLERESTORY_REQUIRE_GPU").is_none(), "there is no Xvfb");
            eprintln!("skipped: there is no Xvfb");
            return None;
        };
        let mut number = String::new();
        std::io::BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Screen { server, name: format!(":{}", number.trim()) })
    }
}

#[cfg(target_os = "linux")]
impl Drop for Screen {
    fn drop(&mut self) {
        // Whether it had ended by itself is no matter.
        self.server.kill().ok();
        self.server.wait().ok();
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_window_has_the_keyboard_where_no_window_manager_gives_it() {
    use x11rb::protocol::xproto::ConnectionExt;

    let (folder, Some(screen)) = (desk(), Screen::open()) else { return };
    let mut editor = clerestory(folder.path());
    editor.arg("room.gltf").env("DISPLAY", &screen.name).env("HOME", folder.path());
    for variable in ["XDG_CONFIG_HOME", "XDG_DATA_HOME", "XDG_CACHE_HOME", "XDG_RUNTIME_DIR"] {
        editor.env(variable, folder.path());
    }
    let mut editor = editor.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
    let display = x11rb::connect(Some(&screen.name)).unwrap().0;
    // Before, the screen itself or nobody has it.
    let has_keyboard = || display.get_input_focus().unwrap().reply().unwrap().focus > 1;
    let deadline = Instant::now() + Duration::from_secs(120);
    while !has_keyboard() && editor.try_wait().unwrap().is_none() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(20));
    }
    let (has_it, ended) = (has_keyboard(), editor.try_wait().unwrap());
    editor.kill().ok();
    let said = editor.wait_with_output().unwrap().stderr;
    assert!(has_it, "{ended:?} {}", String::from_utf8_lossy(&said));
}
