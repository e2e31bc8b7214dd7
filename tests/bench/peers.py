"""Registration methods under one signature: (before, after, mask) → (u px, α rad), None where the method gives up.

Every method is given one thread, the same two 8-bit pictures and the Euclidean model where it has one; masks go to
those methods that take one. ECC has OpenCV's own defaults: 50 iterations, a Gaussian of 5 px, and a gain of 1e-3 to
stop at, 1e-6 in the multi-scale form. "ECC 1e-6" is the first with the criterion of the second.
"""

from collections.abc import Callable
from functools import partial

import cv2
import numpy as np
import SimpleITK as sitk  # noqa: N813
from pystackreg import StackReg

from probewatch.appliance.core.registration.keyframe import Keyframe
from probewatch.appliance.core.registration.pyramid import centre_px, pyramid
from probewatch.drivers.samples import GreyImage
from tests.bench.scenes import Bits
from tests.support.rendered import Warp

BOTH = cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT
COARSE, FINE = (BOTH, 50, 1e-3), (BOTH, 50, 1e-6)
SMOOTHED_PX = 5
Method = Callable[[GreyImage, GreyImage, Bits | None], Warp | None]


def cold(before: GreyImage, after: GreyImage, mask: Bits | None) -> Warp | None:
    return _ours(Keyframe(pyramid(before), 1.0, mask), after)


def accurate(before: GreyImage, after: GreyImage, mask: Bits | None) -> Warp | None:
    return _ours(Keyframe(pyramid(before), 1.0, mask, accurate=True), after)


def kept(keyframe: Keyframe) -> Method:
    """With the keyframe's part done before; the pyramid of the new picture is part of the time."""
    return lambda _, after, mask: _ours(keyframe, after)


def ecc(
    before: GreyImage, after: GreyImage, mask: Bits | None, criteria: tuple[int, int, float] = COARSE
) -> Warp | None:
    start, seen = np.eye(2, 3, dtype=np.float32), _bytes(mask)
    try:
        found = cv2.findTransformECC(
            before,
            after,
            start,
            cv2.MOTION_EUCLIDEAN,
            criteria,
            seen,  # type: ignore[arg-type]  # OpenCV's stubs deny the None that it takes
            SMOOTHED_PX,
        )
    except cv2.error:
        return None
    return _centred(found[1])


def ecc_multi_scale(before: GreyImage, after: GreyImage, mask: Bits | None) -> Warp | None:
    parameters = cv2.ECCParameters()
    parameters.motionType, parameters.criteria, parameters.gaussFiltSize = cv2.MOTION_EUCLIDEAN, FINE, SMOOTHED_PX
    try:
        found = cv2.findTransformECCMultiScale(
            before, after, np.eye(2, 3, dtype=np.float32), parameters, _bytes(mask), _bytes(mask)
        )
    except cv2.error:
        return None
    return _centred(found[1])


def phase_correlation(before: GreyImage, after: GreyImage, mask: Bits | None) -> Warp | None:
    window = cv2.createHanningWindow((before.shape[1], before.shape[0]), cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(before.astype(np.float32), after.astype(np.float32), window)
    return np.array([dx, dy]), 0.0


def lucas_kanade(before: GreyImage, after: GreyImage, mask: Bits | None) -> Warp | None:
    """400 corners, pyramidal Lucas–Kanade, RANSAC over a similarity."""
    corners = cv2.goodFeaturesToTrack(before, 400, 0.01, 7, mask=_bytes(mask))
    if corners is None:
        return None
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, after, corners, np.empty_like(corners), winSize=(21, 21), maxLevel=4
    )
    good = found.ravel() == 1
    if np.count_nonzero(good) < 8:
        return None
    M, _ = cv2.estimateAffinePartial2D(corners[good], there[good], method=cv2.RANSAC, ransacReprojThreshold=1.0)
    return None if M is None else _centred(M)


def turboreg(before: GreyImage, after: GreyImage, mask: Bits | None) -> Warp | None:
    return _centred(StackReg(StackReg.RIGID_BODY).register(before, after)[:2])


def simple_itk(before: GreyImage, after: GreyImage, mask: Bits | None) -> Warp | None:
    """Mattes' mutual information is for other modalities; here correlation, four levels, regular steps."""
    method = sitk.ImageRegistrationMethod()
    method.SetMetricAsCorrelation()
    method.SetMetricSamplingStrategy(method.REGULAR)
    method.SetMetricSamplingPercentage(0.2, seed=1)
    method.SetInterpolator(sitk.sitkLinear)
    method.SetOptimizerAsRegularStepGradientDescent(2.0, 1e-3, 100)
    method.SetOptimizerScalesFromPhysicalShift()
    method.SetShrinkFactorsPerLevel([8, 4, 2, 1])
    method.SetSmoothingSigmasPerLevel([4, 2, 1, 0])
    if mask is not None:
        method.SetMetricFixedMask(sitk.GetImageFromArray(mask.astype(np.uint8)))
    start = sitk.Euler2DTransform()
    start.SetCenter(centre_px(before.shape[1], before.shape[0]).tolist())
    method.SetInitialTransform(start, inPlace=True)
    try:
        fixed, moving = (sitk.GetImageFromArray(image.astype(np.float32)) for image in (before, after))
        method.Execute(fixed, moving)
    except RuntimeError:
        return None
    return np.array(start.GetTranslation()), float(start.GetAngle())


PEERS: dict[str, Method] = {
    "ECC": ecc,
    "ECC 1e-6": partial(ecc, criteria=FINE),
    "ECC pyramid": ecc_multi_scale,
    "phase corr.": phase_correlation,
    "LK + RANSAC": lucas_kanade,
    "TurboReg": turboreg,
    "SimpleITK": simple_itk,
}


def one_thread() -> None:
    """For every library here that has threads of its own; BLAS is told by the environment."""
    cv2.setNumThreads(1)
    sitk.ProcessObject.SetGlobalDefaultNumberOfThreads(1)


def _ours(keyframe: Keyframe, after: GreyImage) -> Warp | None:
    found = keyframe.register(pyramid(after))
    return found.u_px, found.alpha_rad


def _bytes(mask: Bits | None) -> GreyImage | None:
    return None if mask is None else mask.astype(np.uint8) * np.uint8(255)


def _centred(M: np.ndarray) -> Warp:
    """(2, 3) pixel → pixel of `after`, origin at the corner → (u, α) about the picture's centre."""
    centre = centre_px(640, 480)
    return M[:, :2] @ centre + M[:, 2] - centre, float(np.arctan2(M[1, 0], M[0, 0]))
