"""A tip that sticks to a wall by Drake's friction: no law of the slip says with what force, and that is noise."""

from dataclasses import replace

import numpy as np
import pytest

from drake_cafim.contact.law import ContactLaw, ContactParameters
from drake_cafim.diagnosis.rows.samples import samples_of
from drake_cafim.diagnosis.rows.weak_form import WeakForm
from drake_cafim.diagnosis.whitening.contact_at_rest import contact_at_rest_covariance
from drake_cafim.diagnosis.whitening.contact_step import contact_step_covariance
from drake_cafim.diagnosis.whitening.covariance import whitening
from drake_cafim.recordings.recording import Recording
from drake_cafim.scenario.physics import Physics
from drake_cafim.scene.scene import Scene

FRICTION = 0.4


@pytest.fixture(scope="module")
def pressed() -> tuple[WeakForm, Physics, float]:
    """The arm of rubbing pressed against its wall: at rest for half a second, then sliding; and the normal force."""
    scene = Scene.load("rubbing")
    contact = scene.physics.contacts[0]
    time = 0.002 * np.arange(500)
    rate = np.where(time < 0.5, 0.0, 0.3)
    q0 = np.array([-2.0523, -1.2284, 1.522, -2.0797, 2.0121, 0.4472, 0.9845])
    q = np.tile(q0, (500, 1))
    q[:, 6] += np.cumsum(rate) * 0.002
    v = np.zeros_like(q)
    v[:, 6] = rate
    columns = {f"{kind}.joint{j + 1}": x[:, j] for kind, x in (("q", q), ("v", v), ("u", 0.0 * q)) for j in range(7)}
    columns |= {f"wrench.tip.{axis}": np.zeros(500) for axis in ("fx", "fy", "fz", "tx", "ty", "tz")}
    std = {name: scene.std(name) or 0.0 for name in columns}
    form = WeakForm(samples_of(scene, Recording("a", time, columns), std), scene.wrench_sensors)
    own = ContactParameters(modulus=2300.0, radius=0.04, friction=FRICTION, slip_velocity=0.001)
    p_WC = form.motion(scene.physics).point(contact.joint, contact.p_JC)[0][0]
    wall = replace(contact, law=ContactLaw("hydroelastic"), parameters=own, point=p_WC + 0.02 * np.eye(3)[1])
    physics = scene.physics.changed(contacts=(wall,))
    return form, physics, float(-wall.force(wall.touch(form.motion(physics)))[0][0, 1])


def test_what_holds_a_tip_is_noise_while_it_sticks(pressed: tuple[WeakForm, Physics, float]) -> None:
    form, physics, normal = pressed
    covariance = contact_at_rest_covariance(form, physics)
    variance = covariance.diagonal().reshape(-1, form.rows_per_window)
    force = variance[:, form.dynamic.stop : form.dynamic.stop + 3].sum(axis=1)
    sticking = form.samples.windows.centers < 0.4
    # each window's mean force is in doubt by up to μ λ in two directions, all through: its weights' sum times that
    whole = np.asarray(form.samples.windows.value.sum(axis=1)).ravel() * FRICTION * normal
    np.testing.assert_allclose(np.sqrt(force[sticking]), np.sqrt(2.0) * whole[sticking], rtol=0.1)
    assert np.all(variance[form.samples.windows.centers > 0.6] == 0.0)


def test_rows_are_whitened_with_that_noise(pressed: tuple[WeakForm, Physics, float]) -> None:
    form, physics, _ = pressed
    variance, of_contact = (
        found.reshape(-1, form.rows_per_window)[form.samples.windows.centers < 0.4]
        for found in (
            whitening(form, physics)[0].covariance.diagonal,
            contact_at_rest_covariance(form, physics).diagonal(),
        )
    )
    assert np.any(of_contact > 0.0) and np.all(variance >= of_contact)


def test_friction_of_a_stated_width_leaves_no_doubt(pressed: tuple[WeakForm, Physics, float]) -> None:
    form, physics, _ = pressed
    (wall,) = physics.contacts
    spring = replace(wall, law=ContactLaw("kelvin_voigt"), parameters=replace(wall.parameters, stiffness=100.0))
    assert contact_at_rest_covariance(form, physics.changed(contacts=(spring,))).nnz == 0


def test_where_within_a_sample_a_slip_sets_in_is_noise(pressed: tuple[WeakForm, Physics, float]) -> None:
    form, physics, normal = pressed
    variance = contact_step_covariance(form, physics).diagonal().reshape(-1, form.rows_per_window)
    force = variance[:, form.dynamic.stop : form.dynamic.stop + 3].sum(axis=1)
    # the tip is at rest until .5 s, then slides, and friction begins: half of that in doubt at the two samples between
    (wall,) = physics.contacts
    pushed, _ = wall.force(wall.touch(form.motion(physics)))
    begins = 0.5 * np.gradient(pushed - pushed @ np.outer(wall.normal, wall.normal), axis=0)
    assert np.linalg.norm(begins, axis=1).max() > 0.2 * FRICTION * normal
    value = form.samples.windows.value.toarray()
    alike, anew = ((value @ begins) ** 2).sum(axis=1), (value**2 @ begins**2).sum(axis=1)
    over = np.abs(form.samples.windows.centers - 0.5) < 0.03
    assert over.any() and np.all(anew[over] > 0.2 * alike[over])
    np.testing.assert_allclose(force[over], (alike + anew)[over], rtol=0.02)
