//! Colours and distances of the interface, dark and light.

use adjsplat::splat::Mode;
use egui::{Color32, Context, CornerRadius, Stroke, TextStyle, Theme, Visuals, vec2};

/// Sets the look of the interface.
pub fn apply(context: &Context) {
    #[cfg(target_arch = "wasm32")]
    context.set_fonts(fonts());
    context.set_visuals_of(Theme::Dark, dark());
    context.set_visuals_of(Theme::Light, light());
    for theme in [Theme::Dark, Theme::Light] {
        context.style_mut_of(theme, |style| {
            style.spacing.item_spacing = vec2(8.0, 6.0);
            style.spacing.button_padding = vec2(8.0, 4.0);
            style.spacing.interact_size.y = 24.0;
            style.spacing.slider_width = 130.0;
            style.spacing.combo_width = 130.0;
            // The scroll bar lies beside what scrolls, not over it.
            style.spacing.scroll.floating_allocated_width = 6.0;
            // It would fade to the fill of panels, which is transparent.
            style.spacing.scroll.fade.strength = 0.0;
            for (text, size) in [(TextStyle::Small, 11.5), (TextStyle::Monospace, 12.5)] {
                style.text_styles.entry(text).and_modify(|font| font.size = size);
            }
        });
    }
}

/// Returns the font of a page. The others would double the bytes of the module.
#[cfg(target_arch = "wasm32")]
fn fonts() -> egui::FontDefinitions {
    use egui::{FontData, FontDefinitions, FontFamily};
    let mut fonts = FontDefinitions::empty();
    let font = FontData::from_static(epaint_default_fonts::UBUNTU_LIGHT);
    fonts.font_data.insert("text".into(), std::sync::Arc::new(font));
    for family in [FontFamily::Proportional, FontFamily::Monospace] {
        fonts.families.insert(family, vec!["text".into()]);
    }
    fonts
}

/// Returns the colour behind a volume in this theme, sRGB.
pub fn background(is_dark: bool) -> [u8; 3] {
    if is_dark { [18, 20, 24] } else { [255, 255, 255] }
}

/// Returns the colour behind a volume when it is drawn in another mode than `before`: black behind sums and maxima, as
/// `adj render` has it, unless `shown` is a colour that was chosen.
pub fn background_in(mode: Mode, before: Mode, shown: [u8; 3], is_dark: bool) -> [u8; 3] {
    let of_mode = |mode| if mode == Mode::Composite { background(is_dark) } else { [0; 3] };
    if shown == of_mode(before) { of_mode(mode) } else { shown }
}

fn dark() -> Visuals {
    let mut visuals = Visuals::dark();
    visuals.window_fill = Color32::from_rgb(30, 33, 39);
    visuals.extreme_bg_color = Color32::from_rgb(18, 20, 24);
    visuals.override_text_color = Some(Color32::from_rgb(222, 226, 232));
    visuals.selection.bg_fill = Color32::from_rgb(38, 92, 138);
    visuals.selection.stroke = Stroke::new(1.0, Color32::from_rgb(128, 192, 240));
    rounded(visuals)
}

fn light() -> Visuals {
    let mut visuals = Visuals::light();
    visuals.window_fill = Color32::from_rgb(244, 245, 247);
    visuals.extreme_bg_color = Color32::WHITE;
    visuals.override_text_color = Some(Color32::from_rgb(34, 38, 44));
    visuals.warn_fg_color = Color32::from_rgb(168, 84, 0);
    visuals.selection.bg_fill = Color32::from_rgb(190, 219, 244);
    visuals.selection.stroke = Stroke::new(1.0, Color32::from_rgb(16, 84, 140));
    rounded(visuals)
}

fn rounded(mut visuals: Visuals) -> Visuals {
    // The window is cleared with `window_fill`: where the processor paints it, filling panels once more takes longer than all
    // their text.
    visuals.panel_fill = Color32::TRANSPARENT;
    let widgets = &mut visuals.widgets;
    for widget in [&mut widgets.noninteractive, &mut widgets.inactive, &mut widgets.hovered, &mut widgets.active] {
        widget.corner_radius = CornerRadius::same(4);
    }
    visuals
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_grey_maximum_is_not_white_on_white() {
        let in_mode = |mode, before, shown| background_in(mode, before, shown, false);
        assert_eq!(in_mode(Mode::MaximumGrey, Mode::Composite, background(false)), [0; 3]);
        assert_eq!(in_mode(Mode::Additive, Mode::MaximumGrey, [0; 3]), [0; 3]);
        assert_eq!(in_mode(Mode::Composite, Mode::MaximumGrey, [0; 3]), background(false));
        assert_eq!(in_mode(Mode::Maximum, Mode::Composite, [9, 8, 7]), [9, 8, 7], "a chosen colour stays");
    }
}
