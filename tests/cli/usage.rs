//! Help, wrong flags, completions, and readers that go away.

use std::process::Stdio;

use adjsplat_tests::say;

use super::harness::{Folder, RAW, Ran, Runs as _, adj, nrrd, program};

/// The subcommands of `words`, as the help lists them.
fn commands_of(words: &[&str]) -> Vec<String> {
    let help = adj([words, &["--help"]].concat()).done();
    let list = help.split("Commands:\n").nth(1).expect("a list of commands");
    let lines = list.lines().take_while(|line| !line.is_empty());
    let names = lines.filter(|line| line.starts_with("  ") && !line.starts_with("   "));
    let names: Vec<String> = names.filter_map(|line| line.split_whitespace().next()).map(str::to_owned).collect();
    names.into_iter().filter(|name| name != "help").map(|name| [words, &[&name]].concat().join(" ")).collect()
}

/// All of them, with those of `study`.
fn commands() -> Vec<String> {
    [commands_of(&[]), commands_of(&["study"])].concat()
}

#[test]
fn every_command_has_help_with_an_example_that_parses() {
    let commands = commands();
    for name in ["build", "info", "verify", "trim", "completions", "study", "study speed", "study cache"] {
        assert!(commands.iter().any(|command| command == name), "{name}");
    }
    for command in &commands {
        let command = command.as_str();
        let asked = |flag: &str| adj(command.split(' ').chain([flag])).done();
        let help = asked("--help");
        assert!(help.contains("Example") && help.contains(&format!("adj {command} ")), "{help}");
        assert!(!help.contains('\u{1b}'), "colours only for a terminal: {help:?}");
        let short = asked("-h");
        assert!(short.contains("Usage: adj"), "{short}");
        if command == "demo" {
            continue; // its example works: it draws a picture
        }
        let examples = help.split("Example").nth(1).expect("it is there");
        let typed = |line: &str| line.trim_start_matches([':', 's', ' ']).strip_prefix("adj ").map(str::to_owned);
        for line in examples.lines().filter_map(typed) {
            let line = line.split(['>', '(', '&']).next().expect("a part");
            let ran = Folder::new().adj(line);
            // The file is missing, and nothing else is wrong.
            let fine = ran.code == Some(0) || ran.stderr.contains("cannot open") || ran.stderr.contains("cannot read");
            assert!(fine && !ran.stderr.contains("--help"), "{line}: {}", ran.stderr);
        }
    }
}

/// It explained none.
#[test]
fn the_help_of_info_explains_every_number() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    folder.adj("trim a.adj --levels 1 -q -o b.adj").done();
    let help = adj(["info", "--help"]).done();
    let info = folder.adj("info b.adj --json").json();
    let inner = [&info["channels"], &info["levels"][0]].map(|value| value.as_object().expect("of members"));
    // These are no numbers, or need no explanation.
    let plain = ["file", "description", "tile_order", "level"];
    for name in info.as_object().expect("of members").keys().chain(inner.into_iter().flat_map(|members| members.keys()))
    {
        assert!(plain.contains(&name.as_str()) || help.contains(name.as_str()), "{name} is not in: {help}");
    }
}

#[test]
fn no_arguments_print_the_help_and_fail() {
    let ran = adj::<&str>([]);
    assert_eq!((ran.code, ran.stdout.as_str()), (Some(2), ""));
    assert!(ran.stderr.contains("Usage: adj") && ran.stderr.contains("adj demo"), "{}", ran.stderr);
    assert!(!ran.stderr.contains('\u{1b}'), "colours only for a terminal");
    assert!(adj(["--version"]).done().starts_with("adj 0."));
}

#[test]
fn wrong_flags_are_one_line_that_names_the_help() {
    let refused = |line: &str, parts: &[&str]| Folder::new().adj(line).refused(parts);
    refused("build", &["<IN>", "see adj build --help"]);
    refused("render x.nii", &["--output", "see adj render --help"]);
    refused("build x.nii --lane x -o a.adj", &["--lane", "'--lanes'", "see adj build --help"]);
    refused("build x.nii --lanes y -o a.adj", &["'y'", "x, xy, xyz", "see adj build --help"]);
    refused("build x.nii --order random -o a.adj", &["morton, hilbert, rows"]);
    refused("build x.nii --value-bits 12 -o a.adj", &["'12'", "8, 16"]);
    refused("build x.nii --skip -1 -o a.adj", &["-1"]);
    refused("render x.nii -o a.png --crop -1..3,..,..", &["--crop", "0..127,0..63,10..20"]);
    refused("trim x.adj -o a.adj --crop -1..3,..,..", &["--crop", "0..127,0..63,10..20"]);
    for flag in ["--kernel", "--termination", "--size", "--frames"] {
        let said = refused(&format!("render x.nii -o a.png {flag} -1"), &["'-1'", flag]);
        assert!(!said.contains("-- -1"), "{said}");
    }
    for line in [
        "trim x.adj -o a.adj --levels",
        "render x.adj -o a.png --level",
        "split x.adj -o a.adjs --brick",
        "brick scan p",
    ] {
        let said = refused(&format!("{line} -1"), &["'-1'"]);
        assert!(!said.contains("-- -1"), "what it advises cannot be: {said}");
    }
    refused("build x.nii --iso abc -o a.adj", &["--iso", "abc"]);
    refused("trim x.adj y.adj -o z.adj", &["y.adj", "see adj trim --help"]);
    refused("biuld x.nii", &["biuld", "build", "see adj --help"]);
    refused("--frobnicate", &["--frobnicate", "see adj --help"]);
    refused("verify", &["<FILE>", "see adj verify --help"]);
    refused("info", &["<FILE>", "see adj info --help"]);
    refused("completions tcsh", &["tcsh", "bash", "zsh", "fish"]);
    refused("build x.nii --dims 1x1x1 --type u8 --endian middle -o a.adj", &["middle", "le, be"]);
}

#[test]
fn byte_orders_that_contradict_are_refused() {
    let folder = Folder::new();
    folder.write("r.raw", &[1, 0, 2, 0]);
    let raw = |ty: &str, order: &str| {
        folder.adj(&format!("raw r.raw --dims 2x1x1 --type {ty} --endian {order} -o o.raw --json --quiet"))
    };
    raw("i16be", "le").refused(&["--type i16be: says be, but --endian says le"]);
    raw("i16le", "be").refused(&["--type i16le: says le, but --endian says be"]);
    for (ty, order, first) in [("i16", "be", 0), ("i16be", "be", 0), ("i16", "le", 1), ("I16LE", "le", 1)] {
        raw(ty, order).done();
        assert_eq!(std::fs::read(folder.file("o.raw")).expect("written")[0], first, "{ty} {order}");
    }
}

#[test]
fn completions_for_the_shells() {
    for (shell, sign) in [("bash", "complete -F"), ("zsh", "#compdef adj"), ("fish", "complete -c adj")] {
        let script = adj(["completions", shell]).done();
        assert!(script.contains(sign) && script.contains("value-bits") && script.contains("keep-grid"), "{shell}");
    }
    // What a shell says of its own script, where there is the shell.
    let script = adj(["completions", "bash"]).done();
    let folder = Folder::new();
    folder.write("adj.bash", script.as_bytes());
    match std::process::Command::new("bash").arg("-n").arg(folder.file("adj.bash")).output() {
        Ok(ran) => assert!(ran.status.success(), "{}", String::from_utf8_lossy(&ran.stderr)),
        Err(error) => say(&format!("SKIPPED: bash did not read its script: {error}")),
    }
}

/// Runs with an end of a pipe that nobody reads as stdout or stderr.
fn run_with_closed(line: &str, folder: &Folder, stderr_too: bool) -> Ran {
    let (reader, writer) = std::io::pipe().expect("there are pipes");
    drop(reader);
    let mut command = program();
    command.current_dir(folder.path()).args(line.split_whitespace());
    command.stdout(writer.try_clone().expect("a pipe"));
    if stderr_too {
        command.stderr(writer);
    } else {
        command.stderr(Stdio::piped());
    }
    Ran::new(&command.output().expect("the program was built"))
}

#[test]
fn a_reader_that_goes_away_is_no_trouble() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    let lines = [
        "info a.adj",
        "info a.adj --json",
        "verify a.adj",
        "completions bash",
        "completions zsh",
        "--help",
        "build --help",
        "--version",
        "build phantom:shells --dims 9x9x9 -o b.adj",
    ];
    for line in lines {
        let ran = run_with_closed(line, &folder, false);
        assert_eq!((ran.code, ran.stderr.as_str()), (Some(0), ""), "{line}");
    }
    for (line, code) in [("info gone.adj", 2), ("build", 2), ("", 2), ("info a.adj", 0)] {
        assert_eq!(run_with_closed(line, &folder, true).code, Some(code), "{line}");
    }
    folder.adj("verify b.adj").done();
}

#[test]
#[cfg(target_os = "linux")]
fn a_result_that_could_not_be_written_is_told() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    for line in ["info a.adj", "verify a.adj", "completions fish", "--help", "build --help", "--version"] {
        let full = std::fs::File::options().write(true).open("/dev/full").expect("it is there");
        let ran =
            program().current_dir(folder.path()).args(line.split(' ')).stdout(full).output().expect("it was built");
        assert_eq!(ran.status.code(), Some(2), "{line}");
        assert_eq!(Ran::new(&ran).stderr, "adj: cannot write the result: No space left on device (os error 28)\n");
    }
}

#[test]
fn quiet_pictures_come_without_notes() {
    let folder = Folder::new();
    folder.write("v.nrrd", &nrrd("raw", &RAW));
    let render = |flag: &str| folder.adj(&format!("render v.nrrd -o a.png --size 8x8 {flag}"));
    assert!(render("").stderr.contains("note: "));
    let quiet = render("--quiet");
    assert_eq!((quiet.code, quiet.stderr.as_str()), (Some(0), ""));
}

#[test]
fn flags_for_devices_that_do_nothing_are_told() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    let ran = folder.adj("render a.adj -o a.png --size 8x8 --memory 64MiB --compositor tiles");
    assert_eq!(ran.code, Some(0), "{}", ran.stderr);
    assert!(
        ran.stderr.contains("note: --compositor is for graphics devices, but the processor draws"),
        "{}",
        ran.stderr
    );
}

#[test]
fn a_plot_of_no_finite_sample_is_refused() {
    let folder = Folder::new();
    let header = b"NRRD0004\ntype: float\ndimension: 3\nsizes: 2 2 2\nencoding: raw\nendian: little\n\n";
    folder.write("nan.nrrd", &[&header[..], &[0xff; 32]].concat());
    folder.adj("info nan.nrrd --plot a.png").refused(&["--plot", "no sample is a finite number"]);
    assert_eq!(folder.names(), ["nan.nrrd"]);
}

/// The normal's square was 0 or infinite, and the camera's target was blamed for the angle.
#[test]
fn tiny_and_huge_numbers_are_used_or_named() {
    let folder = Folder::new();
    folder.small_arena("a.adj");
    let render = |flags: &str| folder.adj(&format!("render a.adj -o a.png --size 40x30 {flags}"));
    let picture = |flags: &str| {
        render(flags).done();
        std::fs::read(folder.file("a.png")).expect("it was written")
    };
    let cut = picture("--clip 150,0,0,1,0,0");
    for length in ["1e-300", "1e300", "1e-320"] {
        assert!(picture(&format!("--clip 150,0,0,{length},0,0")) == cut, "{length}");
    }
    render("--clip 0,0,0,0,0,0").refused(&["--clip"]);
    render("--perspective 1e-300").refused(&["--perspective", "too narrow"]);
    render("--perspective 30 --zoom 1e-300").refused(&["--zoom", "1e-300"]);
}

#[test]
fn a_path_that_is_called_like_a_flag_is_no_flag() {
    let folder = Folder::new();
    std::fs::create_dir(folder.file("crop")).expect("a new folder");
    let said = folder.adj("render crop -o x.png").refused(&["is a folder without files"]);
    assert!(said.starts_with("adj: crop: "), "{said}");
    folder.small_arena("a.adj");
    folder.adj("render a.adj -o x.png --threads 0").refused(&["--threads"]);
}

#[test]
fn a_folder_as_a_camera_is_refused_as_a_folder() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 8x8x8 --range 100.. -q -o g.adj").done();
    let line = folder.adj("render g.adj --camera . -o q.png").refused(&["is a folder"]);
    assert!(!line.contains("--output"), "{line}");
}

#[test]
fn results_are_one_line_whatever_the_names_of_files() {
    let folder = Folder::new();
    let path = folder.file("a\nb.adj");
    let output = path.to_str().expect("plain");
    let said = adj(["build", "phantom:gyroid", "--dims", "8x8x8", "--range", "100..", "-q", "-o", output]).done();
    assert!(said.lines().next().is_some_and(|line| line.contains("a\\nb.adj: ")), "{said:?}");
}

#[test]
fn an_output_that_begins_with_a_dash_is_told_how_to_be_given() {
    let folder = Folder::new();
    folder.adj("build phantom:gyroid --dims 8x8x8 --range 100.. -q -o -dash.adj").refused(&["-o=-NAME"]);
    folder.adj("build phantom:gyroid --dims 8x8x8 --range 100.. -q -o=-dash.adj").done();
}
