"""The crawler in ROS 2: a simulator node, a gait player, recordings and pictures of them."""
