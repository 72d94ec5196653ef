"""Controllers to copy: plain rclpy and standard messages, nothing of this package in them. See docs/controllers.md."""
