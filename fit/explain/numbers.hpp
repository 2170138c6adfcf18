// SPDX-License-Identifier: MIT
#pragma once

#include <array>
#include <cstddef>

#include "fit/numeric/angle.hpp"

/// Every number by which `rig explain` decides, each with its reason in docs/method/model.md.
namespace fit::explain::numbers {

constexpr double mechanisms_expected = 1;  ///< Missing of the catalogue, before the recording is seen.
constexpr double forms_expected = 0.1;     ///< Missing outside of it.
constexpr double size_factor_log = 1.15;   ///< Scale of the logarithm of a prior size's factor.
constexpr double free_curve_share = 0.5;  ///< By which a curve of which only the coordinate is certain bends.
constexpr int smooth_deviations = 6;      ///< Cosines by which a formula may bend along its coordinate.
constexpr std::array deviation_shares{1.0, 1.0 / 3, 1.0 / 9};  ///< Of a formula's deviations, alike likely.
constexpr double uneven_mm = 0.1;    ///< By which a good board bends along it, and by a half, a third ...
constexpr int uneven_cosines = 4;    ///< ... in shorter waves.
constexpr double rough_mm = 0.15,    ///< By which places a metre apart of a good board differ ...
    rough_within = 3;                ///< ... and a factor by which boards do.
constexpr double usual_shape = 0.3;  ///< Skewness of usual noise, and by which its kurtosis lies below 3.
constexpr double u_of_bin_edge = 0.05;  ///< Share of a bin within which its end may be elsewhere.
constexpr double named_at = 0.9, set_holds = 0.95;
constexpr double window = 12;            ///< Log odds to the best within which a hypothesis counts.
constexpr double worth_fitting = -3;     ///< Log odds by the score test.
constexpr double contradicted_at = -3;   ///< Log odds that captures give against what was fitted to others.
constexpr double goes_with = 0.97;       ///< Rank correlation of coordinates that a session confounds.
constexpr double fits_as_well = 3;       ///< Log-likelihood by which another name for it may fit worse.
constexpr double function_error = 0.2;   ///< Share to which a function that nobody stated is its cause.
constexpr double describes_at = 0.5;     ///< Share of held-out means that 95 % intervals hold.
constexpr double another_scene_mm = 30;  ///< By which a lidar errs no more.
constexpr std::size_t most_terms = 8;    ///< Of a hypothesis ...
constexpr std::size_t exchanged_terms = 5;  ///< ... and of one whose terms are exchanged one by one.
constexpr std::size_t tries = 6;            ///< Fitted of every ranking.
constexpr std::size_t search_rows = 4000;   ///< Of the mean channel; more are averaged with neighbours ...
constexpr double merged_rad = 4 * rad_per_deg;  ///< ... in so many degrees; beyond that, fewer groups count.
constexpr double least_hazard = 1e-6;           ///< Of a lost or stray sample, where nothing is missing.
constexpr double tail_hazard =
    5e-5;  ///< Of a sample that noise of a real receiver puts beyond any normal one.
constexpr double stray_hazard = 2e-5;      ///< Of a sample of a real receiver that lies anywhere.
constexpr double hazard_of_losses = 1e-3;  ///< Of an echo that is lost whatever it met.
constexpr double form_mm = 3, form_scale = 1e-3, form_deg = 0.05, form_mm2 = 9, form_share = 0.01,
                 form_log_intensity = 0.1, form_inflation = 1;  ///< Typical sizes of forms.

}  // namespace fit::explain::numbers
