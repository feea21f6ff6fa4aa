//! `volpm job`: the passes of a render as tasks of a scheduler. Here is no scheduler, only what one reads.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::picture::default_endings;
use super::planned::Planned;
use crate::image;
use crate::render::{self, Limits};
use crate::scene::description::Description;
use crate::{Error, Result};

#[derive(Args)]
#[command(
    after_help = "The picture is that of `volpm render --passes N`, bit for bit, whatever order tasks run in, and however often. docs/farm.md tells how each scheduler takes its file."
)]
pub struct Arguments {
    #[command(flatten)]
    planned: Planned,
    /// Passes that each task makes; the last one makes those that remain.
    #[arg(long, value_name = "K", value_parser = clap::value_parser!(u32).range(1..))]
    per_task: u32,
    /// What the passes come to: .exr, .png, .pfm, .hdr, or any other ending for a checkpoint; relative to --folder; repeatable.
    /// Default: <scene>.exr and <scene>.png. <scene>.checkpoint, with all passes, is always written.
    #[arg(short, long, value_name = "FILE")]
    out: Vec<PathBuf>,
    /// Where tasks keep their checkpoints, and pictures go; all machines must see it. Default: <scene>.passes in the current folder.
    #[arg(long, value_name = "DIR")]
    folder: Option<PathBuf>,
    /// Where to write the job. A file that exists is never touched. Default: stdout.
    #[arg(long, value_name = "FILE")]
    output: Option<PathBuf>,
    /// Who is to run it.
    #[arg(long, value_name = "FORMAT", default_value = "openjd")]
    format: Format,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Format {
    /// An Open Job Description template (2023-09, as JSON).
    Openjd,
    /// A script that submits itself to Slurm as an array.
    Slurm,
    /// A Snakefile.
    Snakemake,
    /// A script that runs GNU parallel.
    Parallel,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let job = Job::new(arguments)?;
    let text = match arguments.format {
        Format::Openjd => {
            // To stdout: as if it lay in the current folder.
            let folder =
                arguments.output.as_deref().map(canonical).and_then(|path| path.parent().map(Path::to_path_buf));
            let template = job.template(&folder.unwrap_or_else(|| canonical(".")));
            tell_of_undefined(&template);
            super::json(&template)?
        }
        Format::Slurm => job.script(&job.directives(), include_str!("job/slurm.sh")),
        Format::Parallel => job.script("", include_str!("job/parallel.sh")),
        Format::Snakemake => job.snakefile()?,
    };
    let Some(path) = &arguments.output else { return super::print(&text) };
    image::write_new(path, |file| file.write_all(text.as_bytes()))?;
    super::tell(format_args!("{}: {} tasks, then a merge", path.display(), job.tasks));
    Ok(())
}

/// Tells which parameters of a template have no default.
fn tell_of_undefined(template: &Value) {
    let parameters = template["parameterDefinitions"].as_array().into_iter().flatten();
    let undefined = parameters.filter(|parameter| parameter.get("default").is_none());
    let names: Vec<&str> = undefined.filter_map(|parameter| parameter["name"].as_str()).collect();
    if !names.is_empty() {
        super::tell(format_args!(
            "warning: not below the folder of the template, so that whoever submits it must say where: {}",
            names.join(", ")
        ));
    }
}

/// Passes in tasks. Paths and options are text, in one line each.
struct Job {
    /// The scene file without folder and ending.
    stem: String,
    scene: String,
    folder: String,
    /// Files that the scene names.
    files: Vec<String>,
    outs: Vec<String>,
    overrides: Vec<String>,
    passes: u32,
    per_task: u32,
    tasks: u32,
    /// `None`: all that the machine has.
    threads: Option<u16>,
    /// Bytes.
    memory: Option<u64>,
}

impl Job {
    fn new(arguments: &Arguments) -> Result<Job> {
        let planned = &arguments.planned;
        let passes = planned
            .passes
            .ok_or_else(|| Error::Usage("how many passes are to be shared? Say --passes N".to_string()))?;
        // What tasks would refuse is refused here.
        let loaded = super::pool(planned.threads)?.install(|| planned.load())?;
        let limits = Limits { passes: Some(1..=passes), memory: planned.memory, resumable: true, ..Limits::default() };
        limits.parts(&loaded.scene, &loaded.settings, render::volume_photons(&loaded.scene, &loaded.settings))?;

        let scene = canonical(&planned.scene);
        let stem = line(scene.file_stem().map(Path::new).unwrap_or(&scene))?;
        let folder = arguments.folder.clone().unwrap_or_else(|| format!("{stem}.passes").into());
        let mut outs: Vec<String> = arguments.out.iter().map(line).collect::<Result<_>>()?;
        if outs.is_empty() {
            outs.extend(default_endings().iter().map(|ending| format!("{stem}{ending}")));
        }
        outs.push(format!("{stem}.checkpoint"));
        Ok(Job {
            scene: line(&scene)?,
            folder: line(canonical(&folder))?,
            files: files(loaded.description)?,
            outs,
            overrides: planned.overrides().into_iter().map(line).collect::<Result<_>>()?,
            passes,
            per_task: arguments.per_task,
            tasks: passes.div_ceil(arguments.per_task),
            threads: planned.threads,
            memory: planned.memory,
            stem,
        })
    }

    /// `--memory`, as the command line takes it.
    fn size(&self) -> Option<String> {
        self.memory.map(|bytes| if bytes % MIB == 0 { format!("{}MiB", bytes / MIB) } else { format!("{bytes}B") })
    }

    /// The memory that a scheduler should grant, in MiB: an eighth more than the render means to stay below.
    fn granted(&self) -> Option<u64> {
        self.memory.map(|bytes| bytes.saturating_add(bytes / 8).div_ceil(MIB))
    }

    /// Options of each task, but for threads.
    fn options(&self) -> Vec<String> {
        let memory = self.size().map(|size| format!("--memory={size}"));
        memory.into_iter().chain(self.overrides.iter().map(|text| format!("--set={text}"))).collect()
    }

    /// What Slurm reads before it starts the script.
    fn directives(&self) -> String {
        let mut text = format!("#SBATCH --array=0-{}\n#SBATCH --requeue\n#SBATCH --signal=B:TERM@60\n", self.tasks - 1);
        text.extend(self.threads.map(|threads| format!("#SBATCH --cpus-per-task={threads}\n")));
        text.extend(self.granted().map(|mib| format!("#SBATCH --mem={mib}M\n")));
        text
    }

    /// A bash script: what its scheduler reads, the job, and what the scheduler is told.
    fn script(&self, directives: &str, driver: &str) -> String {
        let words = |words: Vec<String>| words.iter().map(|word| quoted(word)).collect::<Vec<_>>().join(" ");
        let mut options = self.options();
        options.extend(self.threads.map(|threads| format!("--threads={threads}")));
        let outs = self.outs.iter().map(|out| format!("--out={out}")).collect();
        format!(
            "#!/bin/bash\n# Made by `volpm job`.\n{directives}set -e -o pipefail\n{}\nscene={}\nfolder={}\noptions=({})\nouts=({})\n\n{TASKS}\n{driver}",
            self.counts(),
            quoted(&self.scene),
            quoted(&self.folder),
            words(options),
            words(outs),
        )
    }

    fn counts(&self) -> String {
        format!("passes={} per_task={} tasks={}", self.passes, self.per_task, self.tasks)
    }

    fn snakefile(&self) -> Result<String> {
        let mut names = self.outs.iter().chain(&self.files).chain([&self.scene]);
        if let Some(name) = names.find(|name| name.contains(['{', '}'])) {
            return Err(Error::Usage(format!("{name}: Snakemake takes braces for wildcards; use another name")));
        }
        // Text and lists of it are the same in JSON and in Python.
        Ok(format!(
            "# Made by `volpm job`.\nPASSES, PER_TASK, TASKS = {}, {}, {}\nTHREADS, MEGABYTES = {}, {}\nSCENE = {}\nFOLDER = {}\nFILES = {}\nOPTIONS = {}\nOUTS = {}\n\n\n{}",
            self.passes,
            self.per_task,
            self.tasks,
            self.threads.unwrap_or(0),
            self.granted().unwrap_or(0),
            json!(self.scene),
            json!(self.folder),
            json!(self.files),
            json!(self.options()),
            json!(self.outs),
            include_str!("job/Snakefile"),
        ))
    }

    /// An Open Job Description template that lies in the folder `base`, by which paths below it are told.
    fn template(&self, base: &Path) -> Value {
        let path = |name: &str, path: &str, object: &str, flow: &str, what: &str| {
            let mut parameter =
                json!({ "name": name, "type": "PATH", "objectType": object, "dataFlow": flow, "description": what });
            // Defaults must lie below the template; what does not is to be given.
            if let Ok(below) = Path::new(path).strip_prefix(base) {
                parameter["default"] = json!(below);
            }
            parameter
        };
        let text = |name: &str, default: String, what: &str| json!({ "name": name, "type": "STRING", "default": default, "description": what });
        let mut parameters = vec![
            path("Scene", &self.scene, "FILE", "IN", "The scene file"),
            path("Folder", &self.folder, "DIRECTORY", "OUT", "Checkpoints of tasks, and pictures"),
            json!({ "name": "Threads", "type": "INT", "minValue": 0, "maxValue": 1024, "default": self.threads.unwrap_or(0), "description": "Threads of a task; 0: all cores" }),
            text(
                "Memory",
                self.size().unwrap_or_default(),
                "What a task takes at most, such as 8GiB; the same for all tasks",
            ),
            text("Overrides", self.overrides.join("\n"), "KEY=VALUE of the scene, one a line; the same for all tasks"),
            text("Outs", self.outs.join("\n"), "Pictures and checkpoints of all passes, one a line"),
        ];
        // Scenes find their files by themselves: these make a farm send them along.
        match &self.files[..] {
            files if files.len() <= MOST_FILES => parameters.extend(files.iter().enumerate().map(|(index, file)| {
                path(
                    &format!("File{index}"),
                    file,
                    "FILE",
                    "IN",
                    "A file that the scene names, at the same place beside it",
                )
            })),
            files => {
                let folder = common_folder(files).display().to_string();
                parameters.push(path(
                    "Files",
                    &folder,
                    "DIRECTORY",
                    "IN",
                    "The files that the scene names, at the same place beside it",
                ));
            }
        }
        let step = |name: &str, index: &str, call: &str| {
            let data =
                format!("set -e -o pipefail\n{}\n{}\n{TASKS}\n{call}\n", self.counts(), include_str!("job/openjd.sh"));
            let arguments = [
                "{{Task.File.Run}}",
                "{{Param.Scene}}",
                "{{Param.Folder}}",
                "{{Param.Threads}}",
                "{{Param.Memory}}",
                "{{Param.Overrides}}",
                "{{Param.Outs}}",
                index,
            ];
            json!({
                "name": name,
                "script": {
                    "embeddedFiles": [{ "name": "Run", "type": "TEXT", "data": data }],
                    "actions": { "onRun": {
                        "command": "bash",
                        "args": arguments,
                        "cancelation": { "mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": 60 },
                    } },
                },
            })
        };
        let mut render = step("Render", "{{Task.Param.Index}}", "render_task \"$7\"");
        render["parameterSpace"] = json!({ "taskParameterDefinitions": [{ "name": "Index", "type": "INT", "range": format!("0-{}", self.tasks - 1) }] });
        if let Some(mib) = self.granted() {
            render["hostRequirements"] = json!({ "amounts": [{ "name": "amount.worker.memory", "min": mib }] });
        }
        let mut merge = step("Merge", "", "merge_tasks");
        merge["dependencies"] = json!([{ "dependsOn": "Render" }]);
        json!({
            "specificationVersion": "jobtemplate-2023-09",
            "name": self.stem.chars().filter(|c| !c.is_control() && !"{}".contains(*c)).take(100).collect::<String>(),
            "description": format!("{} passes in {} tasks, made by `volpm job`", self.passes, self.tasks),
            "parameterDefinitions": parameters,
            "steps": [render, merge],
        })
    }
}

/// What a task does, and what is done after all.
const TASKS: &str = include_str!("job/tasks.sh");

const MIB: u64 = 1 << 20;

/// A job has at most 50 parameters.
const MOST_FILES: usize = 40;

/// The files that a scene names, each once.
fn files(mut description: Description) -> Result<Vec<String>> {
    let mut files: Vec<String> =
        description.files_mut().into_iter().map(|file| line(canonical(file))).collect::<Result<_>>()?;
    files.sort();
    files.dedup();
    Ok(files)
}

/// The deepest folder that holds them all.
fn common_folder(files: &[String]) -> PathBuf {
    let mut paths = files.iter().map(Path::new);
    let first = paths.next().and_then(Path::parent).unwrap_or(Path::new("/"));
    let common = paths.fold(first, |common, path| {
        common.ancestors().find(|folder| path.starts_with(folder)).unwrap_or(Path::new("/"))
    });
    common.to_path_buf()
}

/// A path from the root, without links; of what is not there yet, with those of its name.
fn canonical(path: impl AsRef<Path>) -> PathBuf {
    let path = path.as_ref();
    let absent = || match (path.parent(), path.file_name()) {
        (Some(folder), Some(name)) => {
            let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
            Some(fs::canonicalize(folder).ok()?.join(name))
        }
        _ => None,
    };
    fs::canonicalize(path)
        .ok()
        .or_else(absent)
        .or_else(|| std::path::absolute(path).ok())
        .unwrap_or_else(|| path.into())
}

/// A path or an option as text in one line.
fn line(text: impl AsRef<Path>) -> Result<String> {
    let text = text.as_ref();
    text.to_str()
        .filter(|text| !text.contains(['\n', '\r']))
        .map(str::to_string)
        .ok_or_else(|| Error::Usage(format!("{text:?}: a job holds only text in one line")))
}

/// A word as a shell takes it, whatever is in it.
fn quoted(word: &str) -> String {
    format!("'{}'", word.replace('\'', r"'\''"))
}
