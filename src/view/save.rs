//! Taking away what is seen: pictures, turntables, the camera, and the command that makes the picture.

use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, channel};

use adjsplat::classify::Colour;
use adjsplat::error::{Error, Result};
use adjsplat::splat::{Frame, Mode, Quality};
use adjsplat::{Model, TransferFunction};
use adjsplat_pictures::{Picture, PictureKind, SampleDepth, write_png};
use egui::Context;

use crate::draw::Canvas;
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

/// A picture that is being written.
pub struct Saving {
    /// The file.
    pub path: PathBuf,
    /// The number of pictures.
    pub frames: u32,
    done: Arc<AtomicUsize>,
    is_cancelled: Arc<AtomicBool>,
    result: Receiver<Result<()>>,
}

impl Saving {
    /// Begins to draw and write a picture, whose ending is .png, .apng or .exr: by the processor, or the device of `canvas`.
    pub fn begin(
        path: &Path,
        model: &Model,
        look: &ViewLook,
        form: PictureForm,
        canvas: Option<&Canvas>,
        context: &Context,
    ) -> Saving {
        let (sender, result) = channel();
        let (done, is_cancelled) = (Arc::new(AtomicUsize::new(0)), Arc::new(AtomicBool::new(false)));
        let own = (path.to_owned(), model.clone(), look.clone(), context.clone(), done.clone(), is_cancelled.clone());
        let canvas = canvas.cloned();
        crate::background::run(async move || {
            let (path, model, look, context, done, is_cancelled) = own;
            let step = |frames| {
                done.store(frames, Ordering::Relaxed);
                context.request_repaint();
                if is_cancelled.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
            };
            // Nobody receives if the window was closed.
            let _ = sender.send(save(&path, &model, &look, form, canvas.as_ref(), step).await);
            context.request_repaint();
        });
        Saving { path: path.to_owned(), frames: form.frames, done, is_cancelled, result }
    }

    /// Returns the number of pictures that are drawn.
    pub fn done(&self) -> usize {
        self.done.load(Ordering::Relaxed)
    }

    /// Asks the thread to stop; no file is left.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Returns the result once it is there.
    pub fn result(&self) -> Option<Result<()>> {
        self.result.try_recv().ok()
    }
}

/// Draws a picture, or a full turn, and writes it, as a whole or not at all. `step` is called after each picture. The
/// processor draws, or the device of `canvas`.
///
/// A turn goes into one .apng file, or into numbered files beside `path`: picture-000.png and so on.
///
/// # Errors
/// [`Error::Input`] for another ending; the errors of the renderer, of writing, and of `step`.
pub async fn save(
    path: &Path,
    model: &Model,
    look: &ViewLook,
    form: PictureForm,
    canvas: Option<&Canvas>,
    step: impl Fn(usize) -> Result<()>,
) -> Result<()> {
    let kind = PictureKind::of(path)?;
    let depth = if form.is_deep { SampleDepth::Sixteen } else { SampleDepth::Eight };
    let settings = look.settings(model.grid(), form.size, form.quality)?;
    let mut pictures = Vec::new();
    for index in 0..form.frames {
        let mut eye = look.eye;
        eye.orbit([360.0 * f64::from(index) / f64::from(form.frames), 0.0]);
        let camera = eye.camera()?;
        let mut frame: Frame = match canvas {
            None => model.render(&camera, &settings)?,
            Some(canvas) => canvas.frame(model, &camera, &settings).await?.0,
        };
        if !form.is_transparent {
            frame.over(Colour::from_bytes(look.background).linear());
        }
        let picture = Picture::new(&frame, kind, depth);
        if form.frames > 1 && kind != PictureKind::Apng {
            write(&numbered(path, index), |out| picture.write(out))?;
        } else {
            pictures.push(picture);
        }
        step(index as usize + 1)?;
    }
    match kind {
        PictureKind::Apng => write(path, |out| write_png(out, &pictures)),
        _ => pictures.first().map_or(Ok(()), |picture| write(path, |out| picture.write(out))),
    }
}

/// Returns the path of a turn's picture: picture-007.png for picture.png.
fn numbered(path: &Path, index: u32) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!("{stem}-{index:03}.{ending}"))
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

/// Returns the line that makes this picture in a shell. `transfer`: the transfer function, where the file has another one.
///
/// # Errors
/// The errors of the camera.
pub fn command(
    file: &Path,
    look: &ViewLook,
    model: &Model,
    size: [u32; 2],
    quality: Quality,
    transfer: Option<&TransferFunction>,
) -> Result<String> {
    let mut words = vec!["adj".into(), "render".into(), quoted(&file.display().to_string())];
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
    if let Some(transfer) = transfer {
        flag("--tf", transfer.to_json());
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
