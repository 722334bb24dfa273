use clap::CommandFactory;

use super::*;

#[test]
fn the_command_line_is_consistent() {
    Arguments::command().debug_assert();
}

#[test]
fn defaults_are_those_of_the_manual() {
    let arguments = Arguments::try_parse_from(["clerestory", "bake", "a.glb", "-o", "a.transport"]).unwrap();
    let Some(Command::Bake(bake)) = arguments.command else { panic!("bake was asked for") };
    let view = &bake.options.view;
    assert_eq!((view.spp, view.bounces, view.size, view.seed), (256, None, None, 0));
    assert_eq!((bake.options.tolerance, bake.options.fresh), (40.0, false));
    assert_eq!(bake.options.method, Method::Projected);
    assert_eq!((&view.sky, bake.options.sky_form(&Look::default())), (&None, SkyForm::Patches(1)));
    assert!(view.skips().is_all());
}

#[test]
fn the_sky_is_baked_in_the_patches_of_the_look_unless_others_are_typed() {
    let form = |options: &[&str], divisions: Option<u32>| {
        let line = ["clerestory", "bake", "a.glb", "-o", "a.transport"].iter().chain(options);
        let Some(Command::Bake(bake)) = Arguments::try_parse_from(line).unwrap().command else { panic!("it is bake") };
        let mut look = Look::default();
        look.scene.sky = divisions;
        bake.options.sky_form(&look)
    };
    assert_eq!(form(&[], Some(2)), SkyForm::Patches(2));
    assert_eq!(form(&["--sky-patches", "145"], Some(2)), SkyForm::Patches(1));
    assert_eq!(form(&["--sky-patches", "2305"], None), SkyForm::Patches(4));
}

#[test]
fn a_negative_number_is_the_value_of_its_option() {
    let (bake, relight) = ("bake a.glb -o a.transport", "relight a.transport -o a.png --look a.look");
    let solve = "solve a.transport --look a.look -o b.look";
    for (command, options) in [
        (bake, &["--seed", "--spp", "--bounces", "--threads", "--sun-size", "--tolerance", "--seconds"][..]),
        (bake, &["--sky-patches", "--patches", "--block", "--work-plane"][..]),
        (relight, &["--lamp-samples", "--bits", "--width", "--at", "--fps"][..]),
        ("schedule a.glb -o a.csv", &["--efficacy", "--floor-area"][..]),
    ] {
        for option in options {
            let line = format!("clerestory {command} {option} -1");
            let said = Arguments::try_parse_from(line.split(' ')).unwrap_err().to_string();
            assert!(said.contains(&format!("invalid value '-1' for '{option}")), "{said}");
        }
    }
    // Others are told by what reads them.
    for (command, option) in [(bake, "--camera"), (solve, "--colors"), (solve, "--keep"), (solve, "--pull")] {
        let line = format!("clerestory {command} {option} -1");
        assert!(Arguments::try_parse_from(line.split(' ')).is_ok(), "{line}");
    }
}

#[test]
fn numbers_out_of_range_are_refused() {
    let bad = [
        ["--spp", "0"],
        ["--spp", "-3"],
        ["--seconds", "0"],
        ["--seconds", "nan"],
        ["--size", "0x4"],
        ["--size", "20000x20"],
        ["--size", "12"],
        ["--size", "16384x16384"],
        ["--tolerance", "nan"],
        ["--tolerance", "inf"],
        ["--tolerance", "-4"],
        ["--panel", "a=3"],
        ["--panel", "a=65"],
        ["--panel", "=8"],
        ["--panel", "a"],
        ["--ies", "a.ies"],
        ["--ies", "=a.ies"],
        ["--ies", "a="],
        ["--bounces", "-1"],
        ["--sun-size", "91"],
        ["--sun-size", "1e-25"],
        ["--sensors", "desk"],
        ["--sensors", "=4x4"],
        ["--sensors", "desk=4"],
        ["--sensors", "desk=0x4"],
        ["--sensors", "desk=9999x4"],
        ["--work-plane", "low"],
        ["--work-plane", "nan"],
        ["--work-plane", "0.8:0"],
        ["--work-plane", "0.8:"],
        ["--view", "0,1,2"],
        ["--shift", "0"],
        ["--threads", "0"],
        ["--sky", ""],
        ["--method", "best"],
        ["--method", "kernel=0"],
        ["--sky", "sun:10"],
        ["--sky-patches", "146"],
        ["--no-skip=color", "--json"],
    ];
    for [option, value] in bad {
        let line = ["clerestory", "bake", "a.glb", "-o", "a.transport", option, value];
        assert!(Arguments::try_parse_from(line).is_err(), "{option} {value} was accepted");
    }
}

#[test]
fn pictures_take_the_place_of_a_scene_and_of_its_options() {
    let line = |rest: &str| {
        let line = format!("clerestory bake --images stage -o a.transport {rest}");
        Arguments::try_parse_from(line.split_whitespace().map(str::to_owned))
    };
    assert!(line("--seconds 10").is_err());
    assert!(line("--tolerance 45 --fresh --seed 3 --threads 2 --json --method svd --block 8").is_ok());
    for of_scenes in [
        "a.glb",
        "--spp 4",
        "--size 4x4",
        "--camera 0",
        "--view 0,1,2,0,0",
        "--shift 0,0.1",
        "--bounces 1",
        "--panel a=4",
        "--ies a=b",
        "--unitless",
        "--sun-size 1",
        "--variant a",
        "--no-energy-compensation",
        "--sky uniform",
        "--no-skip",
        "--sky-patches 145",
        "--fast",
        "--exact",
        "--no-denoise",
        "--irradiance",
        "--sensors a=4x4",
        "--work-plane 1",
    ] {
        assert!(line(of_scenes).is_err(), "{of_scenes} was accepted");
    }
    assert!(Arguments::try_parse_from(["clerestory", "bake", "-o", "a.transport"]).is_err());
}

#[test]
fn blocks_have_one_of_three_sides() {
    let side = |rest: &str| {
        let line = format!("clerestory bake a.glb -o a.transport {rest}");
        let parsed = Arguments::try_parse_from(line.split_whitespace().map(str::to_owned)).ok()?;
        match parsed.command {
            Some(Command::Bake(args)) => Some(args.options.block),
            _ => None,
        }
    };
    assert_eq!(["", "--block 8", "--block 32"].map(side), [Some(16), Some(8), Some(32)]);
    assert!(["--block 0", "--block 12", "--block 64", "--block a"].into_iter().all(|wrong| side(wrong).is_none()));
}

#[test]
fn a_panel_name_may_hold_an_equals_sign() {
    let request = parse_panel("a=b=16").unwrap();
    assert_eq!((request.node.as_str(), request.resolution), ("a=b", 16));
}

#[test]
fn a_scene_alone_opens_the_editor() {
    let arguments = Arguments::try_parse_from(["clerestory", "room.glb"]).unwrap();
    assert!(arguments.command.is_none() && arguments.scene == Some("room.glb".into()));
}
