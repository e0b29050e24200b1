//! Taking away what is seen: pictures, turntables, the camera, and the command that makes the picture.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};

use adjsplat::classify::Colour;
use adjsplat::error::{Error, Result};
use adjsplat::splat::{Frame, Mode, Quality, StopRequest};
use adjsplat::{Model, TransferFunction};
use adjsplat_pictures::{Picture, PictureKind, SampleDepth, numbered, write_png};
use egui::Context;

use crate::draw::DeviceModel;
use crate::look::ViewLook;

/// How a picture is saved.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PictureForm {
    /// Columns and rows, each 1 to 16,384.
    pub size: [u32; 2],
    /// Whether the background stays clear.
    pub is_transparent: bool,
    /// Whether samples have 16 bits instead of 8.
    pub is_deep: bool,
    /// How exact the picture is.
    pub quality: Quality,
    /// Number of pictures of a full turn; 1 for the view itself.
    pub frames: u32,
}

impl Default for PictureForm {
    fn default() -> PictureForm {
        PictureForm { size: [800, 600], is_transparent: false, is_deep: false, quality: Quality::High, frames: 1 }
    }
}

/// A picture that is to be saved: what it shows, and how.
pub(crate) struct PictureJob {
    pub(crate) model: Model,
    pub(crate) look: ViewLook,
    pub(crate) form: PictureForm,
    /// The device that draws; `None` for the processor.
    pub(crate) device_model: Option<DeviceModel>,
}

impl PictureJob {
    /// Returns the name that the file has unless the user gives another one.
    pub(crate) fn name(&self) -> &'static str {
        if self.form.frames > 1 { "turn.apng" } else { "picture.png" }
    }
}

/// A picture that is being written.
pub(crate) struct Saving {
    /// The files.
    files: Vec<PathBuf>,
    /// The number of pictures.
    pub(crate) frames: u32,
    done: Arc<AtomicUsize>,
    stop: StopRequest,
    result: Receiver<Result<()>>,
}

impl Saving {
    /// Begins to draw and write a picture, whose ending is .png, .apng or .exr.
    pub(crate) fn begin(path: &Path, job: PictureJob, context: &Context) -> Saving {
        let (sender, result) = channel();
        let (done, stop) = (Arc::new(AtomicUsize::new(0)), StopRequest::default());
        let (files, frames) = (files(path, job.form.frames), job.form.frames);
        let own = (path.to_owned(), context.clone(), done.clone(), stop.clone());
        crate::background::run(async move || {
            let (path, context, done, stop) = own;
            let PictureJob { model, look, form, device_model } = job;
            let step = |frames| {
                done.store(frames, Ordering::Relaxed);
                context.request_repaint();
            };
            // Nobody receives if the window was closed.
            let _ = sender.send(save(&path, &model, &look, form, device_model.as_ref(), &stop, step).await);
            context.request_repaint();
        });
        Saving { files, frames, done, stop, result }
    }

    /// Returns what goes on, in words.
    pub(crate) fn progress(&self) -> String {
        match self.done.load(Ordering::Relaxed) + 1 {
            next if next <= self.frames as usize => format!("Drawing {next} of {}", self.frames),
            _ => format!("Writing {}", self.names()),
        }
    }

    /// Returns the names of the files.
    pub(crate) fn names(&self) -> String {
        names(&self.files)
    }

    /// Returns, in words, which numbered files of a turn are written; `None` if there is none.
    pub(crate) fn written(&self) -> Option<String> {
        let (written, all) = (self.done.load(Ordering::Relaxed), self.files.len());
        (written > 0 && all > 1)
            .then(|| format!("{written} of {all} pictures are written: {}", names(&self.files[..written])))
    }

    /// Asks the thread to stop.
    pub(crate) fn cancel(&self) {
        self.stop.make();
    }

    /// Returns the result once it is there.
    pub(crate) fn result(&self) -> Option<Result<()>> {
        self.result.try_recv().ok()
    }
}

/// The most bytes that an .apng may keep until all its pictures are drawn.
const MOST_KEPT: u64 = 2 << 30;

/// Draws a picture, or a full turn, and writes it, as a whole or not at all. `step` is called after each picture. The
/// processor draws, or the device.
///
/// A turn goes into one .apng file, or into numbered files beside `path`: picture-000.png and so on. They replace no files.
///
/// # Errors
/// [`Error::Input`] for another ending, where a numbered file is there already, and if an .apng would take too much memory;
/// [`Error::Interrupted`] after a request to `stop`; the errors of the renderer and of writing.
pub async fn save(
    path: &Path,
    model: &Model,
    look: &ViewLook,
    form: PictureForm,
    device_model: Option<&DeviceModel>,
    stop: &StopRequest,
    step: impl Fn(usize),
) -> Result<()> {
    let kind = PictureKind::of(path)?;
    let files = files(path, form.frames);
    if let Some(there) = files.iter().find(|file| files.len() > 1 && file.exists()) {
        let why = "is there already; give the turn another name, or remove its numbered pictures";
        return Err(Error::input(there.display().to_string(), why));
    }
    let depth = if form.is_deep { SampleDepth::Sixteen } else { SampleDepth::Eight };
    let kept = kind.kept(depth, form.size.map(u64::from).iter().product(), form.frames);
    if kept > MOST_KEPT {
        let other = if cfg!(target_arch = "wasm32") { "" } else { ", or name it .png, which makes numbered files" };
        let size = kept.div_ceil(1 << 30);
        let why = format!("would take {size} GiB of memory; save fewer or smaller pictures{other}");
        return Err(Error::input(path.display().to_string(), why));
    }
    let settings = look.settings(model.grid(), form.size, form.quality)?.with_stop(stop.clone());
    let write = |path: &Path, content: &dyn Fn(&mut dyn Write) -> std::io::Result<()>| {
        write(path, |out| content(&mut StoppableWriter { out, stop }))
            .map_err(|fault| if stop.is_made() { Error::Interrupted } else { fault })
    };
    let mut pictures = Vec::new();
    for index in 0..form.frames {
        let mut eye = look.eye;
        eye.orbit([360.0 * f64::from(index) / f64::from(form.frames), 0.0]);
        let camera = eye.camera()?;
        let mut frame: Frame = match device_model {
            None => model.render(&camera, &settings)?,
            Some(device_model) => device_model.frame(model, &camera, &settings).await?.0,
        };
        if !form.is_transparent {
            frame.over(Colour::from_bytes(look.background).linear());
        }
        let picture = Picture::new(&frame, kind, depth);
        if files.len() > 1 {
            write(&files[index as usize], &|out| picture.write(out))?;
        } else {
            pictures.push(picture);
        }
        step(index as usize + 1);
    }
    match kind {
        PictureKind::Apng => write(path, &|out| write_png(out, &pictures)),
        _ => pictures.first().map_or(Ok(()), |picture| write(path, &|out| picture.write(out))),
    }
}

/// A writer that fails after a request to stop, so that what is half written is removed.
struct StoppableWriter<'a> {
    out: &'a mut dyn Write,
    stop: &'a StopRequest,
}

impl Write for StoppableWriter<'_> {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        if self.stop.is_made() { Err(std::io::ErrorKind::Other.into()) } else { self.out.write(bytes) }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.out.flush()
    }
}

/// Returns the files that a picture is written to: `path`, or for a turn numbered ones, such as picture-007.png.
pub(crate) fn files(path: &Path, frames: u32) -> Vec<PathBuf> {
    if frames == 1 || PictureKind::of(path).is_ok_and(|kind| kind == PictureKind::Apng) {
        return vec![path.to_owned()];
    }
    numbered(path, frames)
}

/// Returns the path of a file, or those of the first and the last of several.
fn names(files: &[PathBuf]) -> String {
    match files {
        [first, .., last] => format!("{} to {}", first.display(), last.display()),
        _ => files.iter().map(|file| file.display().to_string()).collect(),
    }
}

/// Writes a file as a whole or not at all; in a browser it is downloaded.
///
/// # Errors
/// The errors of writing.
pub(crate) fn write(path: &Path, content: impl FnOnce(&mut dyn Write) -> std::io::Result<()>) -> Result<()> {
    #[cfg(target_arch = "wasm32")]
    {
        let mut bytes = Vec::new();
        content(&mut bytes).map_err(Error::io("encode", path))?;
        crate::page::download(&path.to_string_lossy(), &bytes)
    }
    #[cfg(not(target_arch = "wasm32"))]
    adjsplat::file::write_atomically(path, |out| content(out))
}

/// Returns the camera as the JSON that `adj render --camera` reads.
///
/// # Errors
/// The errors of the camera.
pub fn camera_json(look: &ViewLook) -> Result<String> {
    let camera = look.eye.camera()?;
    serde_json::to_string(&camera).map_err(|fault| Error::input("camera", fault.to_string()))
}

/// The most bytes of a transfer function in a command; Linux takes words of 131,071.
const LONGEST_WORD: usize = 100_000;

/// Returns the line that makes this picture in a shell. `transfer`: the transfer function, where the file has another one; `is_built`:
/// whether `file` is a volume that was built with another one, so that the line builds picture.adj of it first.
///
/// # Errors
/// The errors of the camera; [`Error::Input`] for a transfer function that is too long for a shell.
pub fn command(
    file: &Path,
    is_built: bool,
    look: &ViewLook,
    model: &Model,
    size: [u32; 2],
    quality: Quality,
    transfer: Option<&TransferFunction>,
) -> Result<String> {
    let name = quoted(&file.display().to_string());
    let mut words = match is_built {
        false => vec![format!("adj render {name}")],
        true => vec![format!("adj build {name} -o picture.adj --levels auto && adj render picture.adj")],
    };
    let mut flag = |name: &str, value: String| words.push(format!("{name} {}", quoted(&value)));
    flag("-o", "picture.png".into());
    flag("--size", format!("{}x{}", size[0], size[1]));
    flag("--camera", camera_json(look)?);
    flag("--quality", quality.name().into());
    let mode = match look.mode {
        Mode::Composite => None,
        Mode::Maximum => Some("maximum"),
        Mode::MaximumGrey => Some("maximum-grey"),
        Mode::Additive => Some("xray"),
    };
    if let Some(mode) = mode {
        flag("--mode", mode.into());
    }
    if !look.is_lit {
        words.push("--unlit".into());
    }
    let mut flag = |name: &str, value: String| words.push(format!("{name} {}", quoted(&value)));
    if look.sharpness > 0.0 {
        flag("--sharpness", look.sharpness.to_string());
    }
    if let Some(crop) = look.crop {
        let range = |a: usize| format!("{}..{}", crop.low[a], crop.high[a]);
        flag("--crop", [range(0), range(1), range(2)].join(","));
    }
    if let Some(clip) = look.clip {
        let plane = clip.plane(model.grid());
        let numbers: Vec<String> = plane.point.iter().chain(&plane.normal).map(f64::to_string).collect();
        flag("--clip", numbers.join(","));
    }
    let [r, g, b] = look.background;
    flag("--background", format!("#{r:02x}{g:02x}{b:02x}"));
    if let Some(transfer) = transfer.map(TransferFunction::to_json) {
        if transfer.len() > LONGEST_WORD {
            let why = "is too long for a command; save it, and name its file by --tf";
            return Err(Error::input("the transfer function", why));
        }
        flag("--tf", transfer);
    }
    Ok(words.join(" "))
}

/// Quotes a word for a POSIX shell, if it needs that.
fn quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-+=:,%@".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::quoted;

    #[test]
    fn words_are_quoted_where_a_shell_would_split_them() {
        assert_eq!(quoted("/a/b-c_1.adj"), "/a/b-c_1.adj");
        assert_eq!(quoted("my file.adj"), "'my file.adj'");
        assert_eq!(quoted("it's"), r"'it'\''s'");
        assert_eq!(quoted(""), "''");
        assert_eq!(quoted("#ffffff"), "'#ffffff'");
    }
}
