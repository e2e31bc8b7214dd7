"""The whole chain against one invariant: the contact never outlives its evidence.

A `Cart` (cart.py) is a `World` (world.py: a probe on a plane of speckle, a scanner, a tracker), the line, the device
watchers and the supervisor, driven together in simulated time: frames at 30 Hz, poses at 60 Hz, ticks at 20 Hz, as the
service does it. `Circumstances` (circumstances.py) are what can happen to pictures, poses and stamps. The `Oracle`
(oracle.py) knows the truth of the world and what the room can see (the contact, the newest verdict), and nothing of
how the core works. After every tick it asserts:

a. Age. Contact closed ⇒ for each parameter that the contact asks for, motion showed the calibration in force within
   the age that this parameter may have (30 s; every second cart asks for the offsets too, and for the axial scale
   within 18 s) and one tick before:
   a genuine picture of tissue, rightly stamped, between two genuine and rightly stamped poses at most 250 ms apart,
   while the probe moved in its plane and the true calibration was the reference in this parameter, in polarity, both
   scales and the rotation about the elevational axis. What the line says of a rest extends an age, by 90 s at most and
   never beyond max_verification_age, only where the truth bears it out: between two genuine pictures nothing changed,
   and both show the same place within half the limits.
b. Contradiction. Contact closed ⇒ the newest verdict of the line holds no FAULT, and no check with a sigma lies
   beyond its limit by three of them.
c. No relapse. Once a calibration fault was shown while the true calibration is wrong by more than twice a limit, the
   contact is not closed again while it stays wrong, acknowledged or not.
d. Discovery. The true calibration wrong by more than twice a limit, and 15 s of lively motion in full view since then
   without interruption ⇒ contact open.
e. Liveness. With everything well again, lively motion and a person who acknowledges, the contact closes within 30 s; a
   marker body that was moved while nobody could see it may need a confirmed recalibration first. Without this the
   others would hold for a contact that never closes.
f. Sight. Pictures without steady tissue (black, noise, every second one blank) for 1 s and a tick, and nothing else
   wrong ⇒ contact open. Every second cart takes whatever comes for tissue instead, so that evidence alone must outlast
   noise and black there.

g. Break. The picture, by itself, mirrored, magnified, stretched or moved on the screen by more than a limit, however it
   became so, and a second and a tick since the first genuine one of it ⇒ contact open, whatever the probe does. Where
   it became so gradually (faded, averaged, wiped) while the probe rested, 10 s.

a is generous: it takes as shown whatever any line could have used, so a failure is never a matter of taste.

`Room` (machine.py) is a hypothesis state machine over all of it; `python -m tests.invariant` (`make invariant`) runs it
for 25,000 frames and more. scenarios.py holds the incidents with a name: the five holes by which a contact outlived
its evidence, and the twenty incidents of a bend that no motion could show. test_reopened.py opens the holes again.
"""
