//! Lets the judge draw with the settings of the other renderers: it applies each setting, or refuses it.

use adjsplat::error::{Error, Result};
use adjsplat::internals::supersampled;
use adjsplat::splat::{Camera, Frame, Settings};
use adjsplat::traverse::{SplitForm, VoxelBox};

use super::splat::{Judge, JudgeSettings};

impl Judge {
    /// Draws the picture that a renderer with these settings should draw, without any of its approximations.
    ///
    /// The kernel keeps its sigma, but its radius is [`JudgeSettings`]' own, which leaves nothing out. `sense`, `code` and
    /// `threads` do not change the picture.
    ///
    /// # Errors
    /// [`Error::Input`] if `settings` has a `termination`, an `order`, a `form` other than the default, or the blending
    /// by sheets: the judge has none of these.
    pub fn render(&self, camera: &Camera, settings: &Settings) -> Result<Frame> {
        let refused = |what: &str, why: &str| Err(Error::input(what, format!("{why}; leave it out")));
        if settings.termination.is_some() {
            return refused("termination", "is not for the reference, whose rays do not end early");
        }
        for (what, is_set) in [("order", settings.order.is_some()), ("form", settings.form != SplitForm::default())] {
            if is_set {
                return refused(what, "is not for the reference, which has its own order");
            }
        }
        let draw = |camera: &Camera, settings: &Settings, low_pass: f32| {
            let usual = JudgeSettings::new(settings.size);
            let own = JudgeSettings {
                sigma: settings.kernel.map_or(usual.sigma, |kernel| kernel.sigma.into()),
                low_pass: low_pass.into(),
                mode: settings.mode,
                blending: settings.blending,
                lighting: settings.lighting,
                exposure: settings.exposure.map(f64::from),
                near: settings.near,
                crop: settings.crop.map(|crop| (crop.low, crop.high)),
                clip: settings.clip,
                threads: settings.threads,
                ..usual
            };
            Ok((self.draw(camera, &own)?.to_frame()?, ()))
        };
        let bounds = self.visible().bounds().map(|(low, high)| VoxelBox { low, high });
        Ok(supersampled(self.visible().grid(), bounds, camera, settings, draw)?.0)
    }
}
