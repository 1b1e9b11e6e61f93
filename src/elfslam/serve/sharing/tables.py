"""With whom maps are shared, in the database."""

from __future__ import annotations

from datetime import datetime
from typing import Literal

from sqlalchemy import ForeignKey, String
from sqlalchemy.orm import Mapped, mapped_column

from elfslam.serve.store.database import Base, new_id, now_utc

Shared = Literal["read", "edit"]
"""What can be given to others."""


class MapShare(Base):
    """What somebody else may do to a map: `read` or `edit`."""

    __tablename__ = "map_shares"
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True)
    user_id: Mapped[str] = mapped_column(
        ForeignKey("users.id", ondelete="CASCADE"), primary_key=True, index=True
    )
    may: Mapped[Shared] = mapped_column(String)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class UserGroup(Base):
    """Some people with whom somebody shares maps at once; its name is theirs alone."""

    __tablename__ = "user_groups"
    id: Mapped[str] = mapped_column(primary_key=True, default=new_id)
    user_id: Mapped[str] = mapped_column(ForeignKey("users.id", ondelete="CASCADE"), index=True)
    name: Mapped[str]
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class GroupMember(Base):
    """Somebody in a group."""

    __tablename__ = "group_members"
    group_id: Mapped[str] = mapped_column(
        ForeignKey("user_groups.id", ondelete="CASCADE"), primary_key=True
    )
    user_id: Mapped[str] = mapped_column(
        ForeignKey("users.id", ondelete="CASCADE"), primary_key=True, index=True
    )


class MapGroupShare(Base):
    """What all in a group may do to a map, whoever is in it at that time."""

    __tablename__ = "map_group_shares"
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True)
    group_id: Mapped[str] = mapped_column(
        ForeignKey("user_groups.id", ondelete="CASCADE"), primary_key=True, index=True
    )
    may: Mapped[Shared] = mapped_column(String)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)


class MapLink(Base):
    """What everyone may do to a map who has its link, the secret of which can be shown again."""

    __tablename__ = "map_links"
    map_id: Mapped[str] = mapped_column(ForeignKey("maps.id", ondelete="CASCADE"), primary_key=True)
    secret: Mapped[str]
    may: Mapped[Shared] = mapped_column(String)
    created_utc: Mapped[datetime] = mapped_column(default=now_utc)
