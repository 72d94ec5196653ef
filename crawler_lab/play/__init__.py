"""A page on this machine in which a person drives a crawler: `crawler play SCENE`.

The page holds no model. `server` sends it what `crawler_model.Crawler`, or a robot with the same topics, does thirty
times a second, and takes commands from the one page in control.
"""
