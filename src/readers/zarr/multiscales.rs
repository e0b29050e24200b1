//! Reads OME-Zarr metadata, which describe one image at several resolutions.
//!
//! In: the attributes of a group. Out: the axes, and for each level its array and its position in the world. Levels are
//! in the order of the metadata; the names of their arrays have no meaning.
//!
//! ```text
//! point = scale of all levels * (scale of this level * index + translation of this level) + translation of all levels
//! ```
//!
//! Source: OME-NGFF specification 0.4 and 0.5, sections "axes" and "multiscales" (ngff.openmicroscopy.org); versions
//! 0.1 to 0.3, which only name their axes or always have five.

use std::path::{Component, Path, PathBuf};

use serde_json::{Map, Value};

use super::metadata::{clip, printable};
use adjsplat::error::{Error, Result};

/// The largest supported number of levels: each level is half as large as the one before.
const MOST_LEVELS: usize = 64;

/// The name and the unit of one dimension of the image.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct AxisName {
    pub(super) name: String,
    pub(super) unit: Option<String>,
}

/// One level: the image at one resolution.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct ImageLevel {
    /// The folder of the level's array.
    pub(super) path: PathBuf,
    /// The distance between points along each axis.
    pub(super) scale: Vec<f64>,
    /// The world coordinate of the first point along each axis.
    pub(super) translation: Vec<f64>,
}

/// The levels of an image, the finest first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Multiscales {
    /// The axes, in the order of the arrays' dimensions.
    pub(super) axes: Vec<AxisName>,
    pub(super) levels: Vec<ImageLevel>,
}

/// Returns the image in the group at `path`; `None` if the group holds none.
///
/// # Errors
/// [`Error::Format`] for incomplete metadata, and for transformations other than scale and translation.
pub(super) fn read(path: &Path, attributes: &Map<String, Value>) -> Result<Option<Multiscales>> {
    let found = attributes.get("ome").and_then(|ome| ome.get("multiscales")).or(attributes.get("multiscales"));
    let Some(image) = found.and_then(|list| list.get(0)) else { return Ok(None) };
    let fault = |expected: &str, got: &Value| Error::format(path, 0, "OME-Zarr multiscales", expected, clip(got));
    let axes: Vec<AxisName> = match image.get("axes") {
        // Metadata of version 0.2 or earlier do not name the axes.
        None => ["t", "c", "z", "y", "x"].map(|name| AxisName { name: name.into(), unit: None }).into(),
        Some(Value::Array(axes)) => {
            let axes: Option<Vec<AxisName>> = axes.iter().map(axis).collect();
            axes.filter(|axes| !axes.is_empty()).ok_or_else(|| fault("axes with names", &image["axes"]))?
        }
        Some(other) => return Err(fault("a list of axes", other)),
    };
    let datasets = image["datasets"].as_array().filter(|list| (1..=MOST_LEVELS).contains(&list.len()));
    let datasets = datasets.ok_or_else(|| fault("1 to 64 datasets", &image["datasets"]))?;
    let transforms = |value: &Value| transform(value, axes.len()).map_err(|expected| fault(&expected, value));
    let all = transforms(&image["coordinateTransformations"])?;
    let mut levels = Vec::new();
    for dataset in datasets {
        let (scale, translation) = transforms(&dataset["coordinateTransformations"])?;
        let translation = translation.iter().zip(&all.0).zip(&all.1).map(|((own, scale), all)| own * scale + all);
        levels.push(ImageLevel {
            path: inside(path, &dataset["path"]).ok_or_else(|| fault("a path inside the group", &dataset["path"]))?,
            scale: scale.iter().zip(&all.0).map(|(own, all)| own * all).collect(),
            translation: translation.collect(),
        });
    }
    Ok(Some(Multiscales { axes, levels }))
}

fn axis(value: &Value) -> Option<AxisName> {
    let name = value.as_str().or(value["name"].as_str())?;
    let unit = value["unit"].as_str().map(|unit| match unit {
        "meter" => "m",
        "centimeter" => "cm",
        "millimeter" => "mm",
        "micrometer" => "um",
        "nanometer" => "nm",
        other => other,
    });
    Some(AxisName { name: printable(&name.to_lowercase()), unit: unit.map(printable) })
}

/// Returns the path `value` relative to `path`; `None` if it leads out of the folder.
fn inside(path: &Path, value: &Value) -> Option<PathBuf> {
    let relative = Path::new(value.as_str()?.trim_start_matches('/'));
    relative.components().all(|part| matches!(part, Component::Normal(_))).then(|| path.join(relative))
}

/// Combines a list of transformations into one scale and one translation per axis.
fn transform(list: &Value, axes: usize) -> Result<(Vec<f64>, Vec<f64>), String> {
    let (mut scale, mut translation) = (vec![1.0; axes], vec![0.0; axes]);
    for step in list.as_array().map(Vec::as_slice).unwrap_or_default() {
        let numbers = |field: &str| {
            let list = step[field].as_array().map(|list| list.iter().map(Value::as_f64).collect::<Option<Vec<f64>>>());
            list.flatten().filter(|list| list.len() == axes).ok_or_else(|| format!("{axes} numbers in each {field}"))
        };
        match step["type"].as_str() {
            Some("identity") => {}
            Some("scale") => {
                for (axis, by) in numbers("scale")?.into_iter().enumerate() {
                    scale[axis] *= by;
                    translation[axis] *= by;
                }
            }
            Some("translation") => {
                for (axis, by) in numbers("translation")?.into_iter().enumerate() {
                    translation[axis] += by;
                }
            }
            _ => return Err("transformations by scale, translation or identity".into()),
        }
    }
    Ok((scale, translation))
}
