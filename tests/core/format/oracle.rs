//! The slow twin of `Arena::check`: rules R13 to R20 and R25 to R27, read off adj-1.md with sets and maps instead of sums.
//!
//! It shares the record structs with the library and nothing else.

use adjsplat::arena::{Arena, Lane, LineEnds, Record};
use adjsplat::volume::Axis;

use crate::coarser::{Look, Voxels, coarser, coarser_grid, is_coverage};
use crate::format::mutants::is_whole;

/// Whether the lanes and the levels of an arena that opened are sound.
pub(crate) fn sound(arena: &Arena) -> bool {
    lanes_agree(arena).is_some_and(|voxels| levels_follow(arena, voxels)) && limits_are_sizes(arena)
}

/// Whether limits of levels, if there are any, are numbers of pixels.
fn limits_are_sizes(arena: &Arena) -> bool {
    let all = arena.level_limits().iter().flat_map(|limits| [limits.standard.get(), limits.draft.get()]);
    all.into_iter().all(|pixels| (0.0..=f32::MAX).contains(&pixels))
}

/// The voxels of all lanes, if these are sound and the same.
fn lanes_agree(arena: &Arena) -> Option<Voxels> {
    let lanes: Option<Vec<_>> = arena.lanes().map(|lane| voxels(&lane, arena)).collect();
    let lanes = lanes?;
    let agree = lanes.iter().all(|lane| lane.len() as u64 == arena.facts().visible_voxels && *lane == lanes[0]);
    lanes.into_iter().next().filter(|_| agree)
}

/// Whether each level is whole and sound, and has the places and the coverages that follow from the level below.
fn levels_follow(arena: &Arena, mut below: Voxels) -> bool {
    let (mut grid, mut channels) = (arena.facts().grid.clone(), arena.facts().channels);
    let places = |voxels: &Voxels| -> Vec<_> { voxels.iter().map(|(&at, record)| (at, record.coverage)).collect() };
    (1..=arena.level_count()).all(|number| {
        let level = arena.level(number).expect("it opened with the file");
        let (Some((_, factors)), Some(voxels)) = (coarser_grid(&grid), lanes_agree(&level)) else { return false };
        // The look decides on means alone.
        let expected = coarser(&below, channels, grid.spacing, factors, &Look::default());
        let follows = places(&voxels) == places(&expected);
        (grid, channels, below) = (level.facts().grid.clone(), level.facts().channels, voxels);
        follows && is_whole(level.bytes(), &level)
    })
}

/// The voxels of a lane; `None` if any rule is broken.
fn voxels(lane: &Lane, arena: &Arena) -> Option<Voxels> {
    let ends: Vec<u64> = match lane.line_ends {
        LineEnds::Narrow(ends) => ends.iter().map(|e| e.get().into()).collect(),
        LineEnds::Wide(ends) => ends.iter().map(|e| e.get().into()).collect(),
    };
    let [u_axis, v_axis] = lane.axis.others().map(Axis::index);
    let along = lane.axis.index();
    let (mut line, mut record, mut last_key) = (0usize, 0usize, None);
    let mut found = Voxels::new();
    for tile in lane.tiles {
        let key = arena.facts().tile_order.key(tile.tile_u.get(), tile.tile_v.get());
        if tile.occupancy.get() == 0 || last_key >= Some(key) {
            return None;
        }
        last_key = Some(key);
        if (tile.first_line.get() as usize, tile.first_record.get()) != (line, record as u64) {
            return None;
        }
        let first = record;
        let mut coordinates = Vec::new();
        for bit in (0..64u32).filter(|bit| tile.occupancy.get() & 1 << bit != 0) {
            let u = 8 * u32::from(tile.tile_u.get()) + bit % 8;
            let v = 8 * u32::from(tile.tile_v.get()) + bit / 8;
            let end = first + usize::try_from(*ends.get(line)?).unwrap();
            line += 1;
            let mut next = 0u64;
            let mut last = 0;
            if end <= record || u >= lane.dims[u_axis] || v >= lane.dims[v_axis] {
                return None;
            }
            while record < end {
                last = *lane.steps.get(record)?;
                let codes = lane.record(record);
                if last == 0 {
                    next += 255;
                    if codes != Record::default() {
                        return None;
                    }
                } else {
                    next += u64::from(last);
                    let coordinate = u32::try_from(next - 1).unwrap();
                    let mut at = [0; 3];
                    (at[u_axis], at[v_axis], at[along]) = (u, v, coordinate);
                    coordinates.push(coordinate);
                    let is_uncovered = !is_coverage(codes.coverage, lane.channels);
                    if coordinate >= lane.dims[along] || is_uncovered || found.insert(at, codes).is_some() {
                        return None;
                    }
                }
                record += 1;
            }
            if last == 0 {
                return None;
            }
        }
        let (low, high) = (coordinates.iter().min()?, coordinates.iter().max()?);
        if (*low, *high) != (tile.low.get().into(), tile.high.get().into()) {
            return None;
        }
    }
    (line == ends.len() && record == lane.steps.len()).then_some(found)
}
