"""The motion of bodies in the plane that turn: links have lengths, joints have angles, friction has a direction."""
