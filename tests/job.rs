//! `volpm job`: tasks in any order, repeated, and stopped, come to what one render makes, bit for bit.

use std::ffi::OsStr;
use std::fmt::Debug;
use std::fs;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use openjd_model::{
    CallerLimits, DocumentType, PathParameterOptions, SpecificationRevision, StepDependencyGraph,
    StepParameterSpaceIterator, ValidationContext, create_job, decode_job_template, preprocess_job_parameters,
    template::parse::document_string_to_object,
};
use serde_json::Value;
use volpm::image;

use crate::cli::{FLOOR, SCENE};

const NAME: &str = "a scene that's mine/fog.toml";

/// Options of all jobs here: seven passes in four tasks.
const SHARED: [&str; 6] = ["--passes", "7", "--per-task", "2", "--set", "media.smoke.albedo=[0.8, 0.8, 0.5]"];

fn workplace() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join(NAME);
    fs::create_dir_all(scene.with_file_name("models")).unwrap();
    fs::write(scene.with_file_name("models/floor.obj"), FLOOR).unwrap();
    fs::write(scene, SCENE).unwrap();
    folder
}

/// Runs something where `volpm` is on the path.
fn run<A: AsRef<OsStr>>(folder: &Path, program: &str, arguments: &[A]) -> Output {
    let program = if program == "volpm" { env!("CARGO_BIN_EXE_volpm") } else { program };
    let mut path = Path::new(env!("CARGO_BIN_EXE_volpm")).parent().unwrap().as_os_str().to_os_string();
    path.push(":");
    path.push(std::env::var_os("PATH").unwrap());
    let mut command = Command::new(program);
    command.current_dir(folder).args(arguments).env("PATH", path).stdin(Stdio::null()).output().unwrap()
}

fn done<A: AsRef<OsStr> + Debug>(folder: &Path, program: &str, arguments: &[A]) -> String {
    let output = run(folder, program, arguments);
    assert!(output.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).unwrap()
}

fn refused<A: AsRef<OsStr> + Debug>(folder: &Path, program: &str, arguments: &[A]) -> String {
    let output = run(folder, program, arguments);
    assert_eq!(output.status.code(), Some(2), "{arguments:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stderr).unwrap()
}

/// What one program makes of all passes.
fn whole(folder: &Path) -> Vec<[u32; 3]> {
    done(folder, "volpm", &["render", NAME, "-q", "--passes", "7", "--set", SHARED[5], "-o", "whole.exr"]);
    pixels(&folder.join("whole.exr"))
}

fn pixels(path: &Path) -> Vec<[u32; 3]> {
    image::read(path).unwrap().image.pixels.iter().map(|pixel| pixel.map(f32::to_bits)).collect()
}

/// The words of a step's command, as a scheduler of Open Job Description makes them.
fn command(folder: &Path, template: &Value, step: usize, index: usize, threads: &str) -> Vec<String> {
    let script = &template["steps"][step]["script"];
    let run = folder.join(format!("step {step}.sh"));
    fs::write(&run, script["embeddedFiles"][0]["data"].as_str().unwrap()).unwrap();
    let word = |word: &Value| {
        let Some(name) = word.as_str().unwrap().strip_prefix("{{").and_then(|word| word.strip_suffix("}}")) else {
            return word.as_str().unwrap().to_string();
        };
        match (name, name.strip_prefix("Param.")) {
            ("Task.File.Run", _) => run.display().to_string(),
            ("Task.Param.Index", _) => index.to_string(),
            ("Param.Threads", _) => threads.to_string(),
            (_, Some(name)) => {
                let parameters = template["parameterDefinitions"].as_array().unwrap();
                let parameter = parameters.iter().find(|parameter| parameter["name"] == name).unwrap();
                let default = parameter["default"].as_str().unwrap();
                let is_path = parameter["type"] == "PATH";
                if is_path { folder.join(default).display().to_string() } else { default.to_string() }
            }
            _ => panic!("{name} is no value of a task"),
        }
    };
    let action = &script["actions"]["onRun"];
    assert_eq!(action["command"], "bash");
    action["args"].as_array().unwrap().iter().map(word).collect()
}

#[test]
fn tasks_come_to_the_whole() {
    let folder = workplace();
    let folder = folder.path();
    let expected = whole(folder);
    let template: Value =
        serde_json::from_str(&done(folder, "volpm", &[&["job", NAME], &SHARED[..]].concat())).unwrap();
    assert_eq!(template["specificationVersion"], "jobtemplate-2023-09");
    assert_eq!(template["steps"][0]["parameterSpace"]["taskParameterDefinitions"][0]["range"], "0-3");
    assert_eq!(template["steps"][1]["dependencies"][0]["dependsOn"], template["steps"][0]["name"]);
    let inputs = template["parameterDefinitions"].as_array().unwrap();
    let inputs: Vec<&str> = inputs
        .iter()
        .filter(|parameter| parameter["dataFlow"] == "IN")
        .map(|parameter| parameter["default"].as_str().unwrap())
        .collect();
    assert_eq!(inputs, [NAME, "a scene that's mine/models/floor.obj"]);

    let merge = command(folder, &template, 1, 0, "0");
    // A task that was stopped after one of its two passes.
    let stopped = folder.join("fog.passes/tasks/000002");
    fs::create_dir_all(stopped.parent().unwrap()).unwrap();
    let begun = ["render", NAME, "-q", "--set", SHARED[5], "--pass-range", "6..6", "--fill"];
    done(folder, "volpm", &[&begun[..], &[stopped.to_str().unwrap()]].concat());
    for (index, threads) in [(3, "1"), (0, "2"), (2, "3"), (0, "1")] {
        done(folder, "bash", &command(folder, &template, 0, index, threads));
    }
    // Not yet all.
    let why = refused(folder, "bash", &merge);
    assert!(why.contains("000001"), "{why}");
    done(folder, "bash", &command(folder, &template, 0, 1, "1"));
    done(folder, "bash", &merge);
    let picture = folder.join("fog.passes/fog.exr");
    assert!(pixels(&picture) == expected);
    // Repeated: no file of a finished task is touched.
    let task = folder.join("fog.passes/tasks/000001");
    let before = fs::metadata(&task).unwrap().modified().unwrap();
    done(folder, "bash", &command(folder, &template, 0, 1, "3"));
    assert_eq!(fs::metadata(&task).unwrap().modified().unwrap(), before);
    fs::remove_file(&picture).unwrap();
    done(folder, "bash", &merge);
    assert!(pixels(&picture) == expected);

    // A task that was made of one pass less is told, and so is another scene.
    fs::remove_file(&stopped).unwrap();
    done(folder, "volpm", &[&begun[..], &[stopped.to_str().unwrap()]].concat());
    let why = refused(folder, "bash", &merge);
    assert!(why.contains("of passes 1 to 7 of seed 1, 1 are missing, pass 5 first"), "{why}");
    fs::write(folder.join("a scene that's mine/models/floor.obj"), FLOOR.replace('5', "6")).unwrap();
    let why = refused(folder, "bash", &command(folder, &template, 0, 0, "1"));
    assert!(why.contains("another scene"), "{why}");
}

/// Whom the format is of finds the template valid, as JSON and as YAML, and makes the tasks of it that we mean.
#[test]
fn templates_are_what_farms_read() {
    let folder = workplace();
    let folder = folder.path();
    let template = done(folder, "volpm", &[&["job", NAME], &SHARED[..]].concat());
    let limits = CallerLimits::default();
    for kind in [DocumentType::Json, DocumentType::Yaml] {
        let document = document_string_to_object(&template, kind, &limits).unwrap();
        let template = decode_job_template(document, None, &limits).unwrap();
        let root = folder.to_str().unwrap();
        let paths = PathParameterOptions::new(root, root);
        let values = preprocess_job_parameters(&template, &[].into(), &[], &paths).unwrap();
        let job = create_job(&template, &values, &ValidationContext::new(SpecificationRevision::CURRENT)).unwrap();
        let order = StepDependencyGraph::new(&job).unwrap().topo_sorted_names().unwrap();
        assert_eq!(order, ["Render", "Merge"]);
        let tasks = StepParameterSpaceIterator::new(job.steps[0].parameter_space.as_ref().unwrap()).unwrap();
        assert_eq!(tasks.len(), 4);
        assert!(job.steps[1].parameter_space.is_none());
    }
}

#[test]
fn scripts_run_the_same_tasks() {
    let folder = workplace();
    let folder = folder.path();
    let expected = whole(folder);
    for format in ["slurm", "parallel"] {
        let results = format!("with {format}");
        let options =
            ["--format", format, "--output", "a job.sh", "--folder", &results, "-o", "f.pfm", "--threads", "1"];
        done(folder, "volpm", &[&["job", NAME], &SHARED[..], &options].concat());
        done(folder, "bash", &["-n", "a job.sh"]);
        for index in ["1", "3", "0", "2"] {
            done(folder, "bash", &["a job.sh", "task", index]);
        }
        done(folder, "bash", &["a job.sh", "merge"]);
        assert!(pixels(&folder.join(&results).join("f.pfm")) == expected, "{format}");
        // What is there stays.
        let why = refused(folder, "volpm", &[&["job", NAME], &SHARED[..], &options].concat());
        assert!(why.contains("exists already"), "{why}");
        fs::remove_file(folder.join("a job.sh")).unwrap();
    }
    let snakefile = done(folder, "volpm", &[&["job", NAME, "--format", "snakemake"], &SHARED[..]].concat());
    assert!(snakefile.contains("PASSES, PER_TASK, TASKS = 7, 2, 4"), "{snakefile}");
    // More passes a task than there are: one task.
    let one = done(folder, "volpm", &["job", NAME, "--passes", "3", "--per-task", "9", "--format", "slurm"]);
    assert!(one.contains("#SBATCH --array=0-0"), "{one}");
}

#[test]
fn jobs_that_no_task_could_do_are_refused() {
    let folder = workplace();
    let folder = folder.path();
    for (options, what) in [
        (&["--passes", "0", "--per-task", "2"][..], "--passes"),
        (&["--passes", "4", "--per-task", "0"], "--per-task"),
        (&["--per-task", "2"], "--passes N"),
        (&["--passes", "4", "--per-task", "2", "--set", "volume.radius=-1"], "volume.radius"),
        (&["--passes", "4", "--per-task", "2", "--memory", "1MiB"], "are not enough"),
        (&["--passes", "4", "--per-task", "2", "--format", "snakemake", "-o", "{a}.exr"], "braces"),
        (&["--passes", "4", "--per-task", "2", "--set", "title=\"\"\"a\nb\"\"\""], "one line"),
    ] {
        let why = refused(folder, "volpm", &[&["job", NAME], options].concat());
        assert!(why.contains(what), "{options:?}: {why}");
    }
    let why = refused(folder, "volpm", &["job", "missing.toml", "--passes", "4", "--per-task", "2"]);
    assert!(why.contains("missing.toml"), "{why}");
}
